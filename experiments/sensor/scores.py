"""How good a reader is on touches of objects it never saw."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet
from activetouch.perception.reader import ImageReader, Reading, TactileReader
from belief.calibration import TemperatureScaling
from belief.metrics import negative_log_likelihood
from belief.statistics import clopper_pearson_interval, cluster_bootstrap
from belief.touch_batch import TouchBatch
from experiments.parallel import progress_bar


@dataclass(frozen=True)
class Scores:
    """Of single touches.

    Attributes:
        accuracy: share of the test touches read correctly.
        interval: of the accuracy, 95 %, as of :func:`accuracy_of_objects`.
        nll: of the test touches, after temperature scaling on the calibration split [nats].
    """

    accuracy: float
    interval: tuple[float, float]
    nll: float

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.accuracy:.4f} [{low:.4f}, {high:.4f}]"


def read_touches(reader: TactileReader, touches: TouchSet, what: str) -> TouchBatch:
    """What a reader makes of recorded touches, as one sequence, with a progress bar."""
    return read_images(reader, touches.images, touches.poses, what)


def read_images(reader: TactileReader, images: NDArray[np.uint8], poses: NDArray[np.int64], what: str) -> TouchBatch:
    """What a reader makes of images and the poses they were felt in ``(N,)``, as one sequence, with a progress bar."""
    logits, embeddings = zip(*((r.logits, r.embeddings) for r in readings(reader, images, what)), strict=True)
    kept = np.concatenate(embeddings)[None] if reader.hypotheses is not None else None
    return TouchBatch(poses[None], np.concatenate(logits)[None], kept)


def readings(reader: ImageReader, images: NDArray[np.uint8], what: str) -> Iterator[Reading]:
    """Everything read of many images, some hundred at a time, with a progress bar."""
    with progress_bar() as progress:
        bar = progress.add_task(what, total=len(images))
        for first in range(0, len(images), 256):
            reading = reader.read(images[first : first + 256])
            yield reading
            progress.advance(bar, len(reading.logits))


def accuracy_of_objects(
    right: NDArray[np.generic], objects: NDArray[np.generic], rng: np.random.Generator
) -> tuple[float, float, float]:
    """Fraction of right touches, with a 95 % bootstrap interval that resamples objects.

    If all objects have one accuracy, for example where all touches are right, or where there is one object, the
    bootstrap would give a point. The interval is then the exact binomial one of as many objects.

    Args:
        right: whether each touch is right, or the fraction that is, ``(n,)``.
        objects: which object each is of, ``(n,)``.
        rng: of the bootstrap.

    >>> found = accuracy_of_objects(np.ones(60), np.arange(60) // 6, np.random.default_rng(0))
    >>> [round(x, 2) for x in found]     # ten objects
    [1.0, 0.69, 1.0]
    """
    accuracy, low, high = cluster_bootstrap(right, objects, rng)
    if low == high:
        number = len(np.unique(objects))
        low, high = clopper_pearson_interval(round(accuracy * number), number)
    return accuracy, low, high


def scores(reader: ImageReader, calibration: TouchSet, test: TouchSet, rng: np.random.Generator) -> Scores:
    """Scores on a test split, with a temperature from the calibration split; ``rng`` is that of the interval."""
    known, read = reader.read(calibration.images, 256), reader.read(test.images, 256)
    scaling = TemperatureScaling().fit(known.logits, calibration.shapes)
    accuracy, low, high = accuracy_of_objects(read.labels == test.shapes, test.object_ids, rng)
    return Scores(accuracy, (low, high), negative_log_likelihood(scaling.predict_proba(read.logits), test.shapes))
