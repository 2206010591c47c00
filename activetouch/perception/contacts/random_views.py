"""What an image would be like of just some body: the currency in which scores of different images are compared.

The score of an image and a hypothesis is log p(image | hypothesis) / p(image) up to a constant of the image
(:class:`activetouch.perception.contacts.hypotheses.Hypotheses`). The log mean of exp(scale · score) over views of
random bodies that no training used is that constant: a score less this mean is log p(image | hypothesis) / p(image |
some body), so that 0 means "as good as any body", and evidence may be compared across images, states and sets.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from activetouch.perception.cached_arrays import cached_array
from activetouch.perception.contacts.bodies import random_body
from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.imaging import Floats32
from activetouch.poses import random_orientation, to_matrices
from activetouch.pressing.height_maps import Window
from activetouch.solids.raster import heights
from belief.validation import Floats

FIRST = 50_000_000
"""Number of the first random body; no training used this number or a later one."""
BODIES, VIEWS, WIDTH = 256, 4, 0.25
"""Bodies, views of each, and the width of the orientations that a view stands for [rad]."""


def random_views(
    reader: ContactHypotheses, codes: Floats32, bodies: int = BODIES, views: int = VIEWS, first: int = FIRST
) -> Floats32:
    """Embeddings of B random bodies, each in a few random views, from the cache or new.

    Args:
        reader: of any object.
        codes: of W states of the sensor, ``(W, STATE_SIZE)``, as of
            :meth:`activetouch.perception.imaging.SensorState.code`.
        bodies: number of bodies.
        views: number of views of each.
        first: number of the first body.

    Returns:
        ``(W, bodies * views, D)``.
    """

    def make() -> Floats32:
        maps = views_of_bodies(reader.imaging.wide_window, bodies, views, first)
        return np.concatenate([reader.embed(some, WIDTH, codes) for some in maps], axis=1)

    state = (np.round(codes, 7) + 0.0).tolist()
    return cached_array({"reader": reader.digest, "state": state, "random": [first, bodies, views, WIDTH]}, make)


def views_of_bodies(window: Window, bodies: int = BODIES, views: int = VIEWS, first: int = FIRST) -> Iterator[Floats32]:
    """Height maps of random bodies [m], each in a few random views, ``(views, n, n)`` of one body after the other."""
    rng = np.random.default_rng([first, 0xBA4C])
    for number in range(first, first + bodies):
        turns = to_matrices(np.stack([random_orientation(rng) for _ in range(views)]))
        pixel, places = window.edge / window.num_pixels, np.zeros((views, 2))
        yield heights(random_body(number), turns, places, pixel, window.num_pixels, np.float32)


def log_normalisers(views: Floats32, embeddings: NDArray[np.floating], scale: float) -> Floats:
    """Log mean of exp(scale · score) over the views ``(B, D)`` of random bodies, for embeddings ``(n, D)``, ``(n,)``.

    >>> log_normalisers(np.zeros((4, 2)), np.ones((3, 2)), 0.8).tolist()
    [0.0, 0.0, 0.0]
    """
    scores = views @ np.asarray(embeddings, np.float32).T
    return np.asarray(logsumexp(np.float32(scale) * scores, axis=0) - np.log(len(views)), float)
