"""Evidence of a sensor from several touches of one object, to be compared with the best possible."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activetouch.sensor import TactileSensor
from belief.touch_batch import TouchBatch
from experiments.bayes_error.touched_objects import TouchedObjects


def sensor_evidence(sensor: TactileSensor, touched: TouchedObjects) -> NDArray[np.float64]:
    """Log likelihood of the first n touches of each object under the sensor's observation model, ``(M, P, K)``.

    Args:
        sensor: reader and observation model.
        touched: the objects, in the order of their touches.
    """
    readings = np.take_along_axis(touched.readings, touched.orders[:, :, None, None], axis=1)
    reading = sensor.reader.read(readings.reshape(-1, *readings.shape[2:]), batch_size=256)
    per_object = (*touched.orders.shape, -1)
    batch = TouchBatch(touched.orders, reading.logits.reshape(per_object), reading.embeddings.reshape(per_object))
    found = [sensor.model.log_likelihood_batch(batch.first(n)) for n in range(1, batch.num_touches + 1)]
    return np.stack(found, axis=1)
