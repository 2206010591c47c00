"""Bodies that feel nearly alike, named before the first touch: what a touch of one tells against the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy  # whose parts load at first use

from activetouch.perception.contacts.views import BodySet
from activetouch.poses import hamilton_product
from activetouch.rotation_cells import centres, nearest
from belief.observation_model.nested_bodies import NestedBodyModel
from belief.validation import Floats

ALIKE = 0.8
"""Information of a touch [nats] below which two bodies are near twins. Most others tell twice as much."""
NOTHING, MOST = 0.5, 0.5
"""Information of a touch [nats] that is next to nothing, and share of such touches from which bodies are near twins."""
_PER_BODY, _MOST_PAIRS = 4, 1200  # pairs that are looked at closely
_SIDES = 24  # views of the first body
_LEVEL = 2  # of the rotations from one body to the other
_SUBSET = 64  # references


@dataclass(frozen=True)
class NearTwins:
    """Labels of two bodies that are hard to tell apart, and the expected information of a touch [nats].

    It is for the touched body against the other in the relative orientation in which it tells least, on a grid of 13°
    and by quarter turns; the smaller of the two ways. ``silent`` is the largest share of touches that tell next to
    nothing, in any such orientation: bodies that differ in one place, such as a handle, are alike elsewhere.
    """

    first: str
    second: str
    nats: float
    silent: float = 0.0

    def __str__(self) -> str:
        silent = f", and {self.silent:.0%} of touches tell next to nothing" if self.silent >= MOST else ""
        favours = f"a touch favours the true one {np.exp(self.nats):.2f} times ({self.nats:.2f} nats)"
        return f"{self.first} and {self.second} feel nearly alike: {favours}{silent}"


def near_twins(model: NestedBodyModel) -> list[NearTwins]:
    """Pairs that a touch hardly tells apart, most alike first, among the four nearest mean embeddings of each body."""
    bodies, labels = model.bodies, model.shape_labels
    assert isinstance(bodies, BodySet), "a sensor gives no others"
    if len(labels) < 2:
        return []
    means = bodies.table.mean(axis=0, dtype=np.float32)  # the same however a body is turned
    found_near = scipy.spatial.cKDTree(means).query(means, min(_PER_BODY + 1, len(labels)))
    distance, near = np.asarray(found_near[0]), np.asarray(found_near[1])
    rows = np.repeat(np.arange(len(labels)), near.shape[1])
    both = np.sort(np.stack([rows, near.ravel()], axis=1), axis=1)
    order = np.argsort(distance, axis=None, kind="stable")
    pairs = list(dict.fromkeys(map(tuple, both[order][both[order, 0] < both[order, 1]].tolist())))
    compare = _comparison(model, bodies)
    found = []
    for i, j in pairs[:_MOST_PAIRS]:
        nats, silent = zip(compare(i, j), compare(j, i), strict=True)
        found.append(NearTwins(labels[i], labels[j], min(nats), max(silent)))
    return sorted([one for one in found if one.nats < ALIKE or one.silent >= MOST], key=lambda one: one.nats)


def _comparison(model: NestedBodyModel, bodies: BodySet) -> Callable[[int, int], tuple[float, float]]:
    """What a touch of one body tells against another, where it tells least, and the largest share of silent touches."""
    references, constants = model.references[:_SUBSET], model.constants[:_SUBSET]
    orientations = bodies.plan.orientations
    sides = np.arange(0, len(orientations), max(1, len(orientations) // _SIDES))[:_SIDES]
    quarters = np.roll(scipy.spatial.transform.Rotation.create_group("O").as_quat(), 1, axis=1)  # files share axes
    seen, turns = orientations[sides].T[:, :, None], np.concatenate([quarters, centres(_LEVEL)]).T[:, None]
    turned = np.stack(hamilton_product(seen, turns), axis=-1).reshape(-1, 4)
    shown = nearest(turned, orientations).reshape(len(sides), -1)

    @cache
    def log_probs(body: int) -> Floats:
        """Log probabilities of the reference touches in every view, ``(V, M)``."""
        scores = bodies.views_of(body) @ references.T - constants
        scores *= np.float32(model.scale)
        return np.asarray(scores - scipy.special.logsumexp(scores, axis=1, keepdims=True))

    def told(body: int, other: int) -> tuple[float, float]:
        mine = log_probs(body)[sides]
        probs = np.exp(mine)
        divergence = (probs * mine).sum(axis=1)[:, None] - probs @ log_probs(other).T
        each = np.take_along_axis(divergence, shown, axis=1)  # of the sides, in each relative orientation
        return max(0.0, float(each.mean(axis=0).min())), float((each < NOTHING).mean(axis=0).max())  # but for rounding

    return told
