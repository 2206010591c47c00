"""How good a reader is on touches of objects it never saw."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet
from activetouch.perception.reader import Reading, TactileReader
from belief.statistics import clopper_pearson_interval, cluster_bootstrap
from belief.touch_batch import TouchBatch
from experiments.parallel import progress_bar


def read_touches(reader: TactileReader, touches: TouchSet, what: str) -> TouchBatch:
    """What a reader makes of recorded touches, as one sequence, with a progress bar."""
    return read_images(reader, touches.images, touches.poses, what)


def read_images(reader: TactileReader, images: NDArray[np.uint8], poses: NDArray[np.int64], what: str) -> TouchBatch:
    """Touches from images and their poses ``(N,)``, as one sequence, with a progress bar."""
    logits, embeddings = zip(*((r.logits, r.embeddings) for r in readings(reader, images, what)), strict=True)
    kept = np.concatenate(embeddings)[None] if reader.hypotheses is not None else None
    return TouchBatch(poses[None], np.concatenate(logits)[None], kept)


def readings(reader: TactileReader, images: NDArray[np.uint8], what: str) -> Iterator[Reading]:
    """Readings of many images in batches, with a progress bar."""
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

    ``right (n,)`` says whether each touch is right, or which fraction; ``objects (n,)`` are the objects of the touches.
    If all objects have one accuracy, the bootstrap would give a point; the interval is then the exact binomial one of
    as many objects.

    >>> found = accuracy_of_objects(np.ones(60), np.arange(60) // 6, np.random.default_rng(0))
    >>> [round(x, 2) for x in found]     # ten objects
    [1.0, 0.69, 1.0]
    """
    accuracy, low, high = cluster_bootstrap(right, objects, rng)
    if low == high:
        number = len(np.unique(objects))
        low, high = clopper_pearson_interval(round(accuracy * number), number)
    return accuracy, low, high
