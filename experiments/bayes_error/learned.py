"""Ambiguity of fine images as far as a trained network sees it: no proof, but numbers where twins give none.

Three questions, asked of the recorded touches that the network learned from and of fresh ones:

* *What would more touches bring this network?* On touches it was fitted to, a network does better than any of its kind
  can do on others. So its accuracy there estimates from above what it could come to with any number of touches, as far
  as its training came to an end.
* *What has a better network to win?* Where images may be turned and mirrored, the mean over all such views is a better
  reader of the same images, and what it wins is there to be won.
* *What could anybody make of what it sees?* The nearest neighbour's accuracy bounds that of every reader of the same
  numbers, given enough known touches (Cover and Hart 1967,
  :func:`experiments.bayes_error.press_features.cover_hart_accuracy`): of the probabilities it gives, few and soon
  settled, and of its features, many and slow. Who sees more in the images than the network does is not bound by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from activetouch.data.dataset import read_manifest, read_split
from activetouch.scene import Symmetry
from belief.statistics import cluster_bootstrap
from experiments.bayes_error.estimator import Findings, Grid, Study, paired_difference, share, words
from experiments.bayes_error.image_bank import symmetric_views
from experiments.bayes_error.press_features import cover_hart_accuracy
from experiments.parallel import progress_bar
from experiments.sensor_choice import require_collection

if TYPE_CHECKING:
    from activetouch.perception.classifier import Reading, TouchClassifier

_AT_ONCE = 256
_PARTS = (16, 8, 4, 2, 1)
SEEN = ("probabilities", "features")
"""What of a network's answer neighbours are looked for in."""


@dataclass(frozen=True)
class LearnedView:
    """What the network saw of a collection bounds what it could learn, and what could be made of it."""

    collection: Path
    """Folder of the touches it learned from."""

    def measure(self, study: Study) -> Findings:
        """See :class:`experiments.bayes_error.estimator.Estimator`."""
        classifier, symmetry = study.sensor.classifier, study.scene.symmetry
        manifest = read_manifest(self.collection)
        require_collection(self.collection, manifest, study.sensor.classifier.card, None, repeats=False)
        learned = read_split(self.collection, "train")
        known = read_views(classifier, learned.images, Symmetry.NONE, "reading what it learned from")
        readings = study.read()
        asked = read_views(classifier, readings, Symmetry.NONE, "reading fresh touches")
        turned = read_views(classifier, readings, symmetry, "reading all views of them")
        right, views_right = asked.labels == study.shapes, turned.labels == study.shapes
        fitted, *interval = cluster_bootstrap(
            known.labels == learned.shapes, learned.object_ids, np.random.default_rng(study.seed)
        )
        sizes = [size for part in _PARTS if (size := len(learned.shapes) // part)]
        neighbours = {}
        for seen in SEEN:
            nearest = nearest_of_first(_seen(known, seen), _seen(asked, seen), sizes)
            found = (learned.shapes[nearest] == study.shapes).mean(axis=1)
            upper = [cover_hart_accuracy(float(value), len(study.scene.shapes)) for value in found]
            neighbours[seen] = {"nearest": found.tolist(), "upper": upper}
        numbers: dict[str, Any] = {
            "estimator": "learned view",
            "classifier": share(right),
            "learned_from": {"value": fitted, "interval": interval},
            "all_views": share(views_right),
            "gain_of_views": paired_difference(views_right, right, study.seed),
            "sizes": sizes,
            "neighbours": neighbours,
        }
        return Findings("Ambiguity, as far as the network sees it", _say(study, numbers), _grids(numbers), numbers)


def read_views(classifier: TouchClassifier, images: NDArray[np.uint8], symmetry: Symmetry, what: str) -> Reading:
    """Mean log probabilities, in place of logits, and mean features, over all views of images as likely as they are."""
    from activetouch.perception.classifier import Reading  # loads torch

    log_probs, features = [], []
    with progress_bar() as progress:
        bar = progress.add_task(what, total=len(images))
        for first in range(0, len(images), _AT_ONCE):
            views = symmetric_views(images[first : first + _AT_ONCE], symmetry)
            found = classifier.read(views.reshape(-1, *views.shape[2:]), _AT_ONCE)
            log_probs.append(log_softmax(found.logits, axis=1).reshape(*views.shape[:2], -1).mean(axis=1))
            features.append(found.features.reshape(*views.shape[:2], -1).mean(axis=1))
            progress.advance(bar, len(views))
    return Reading(np.concatenate(log_probs), np.concatenate(features))


def nearest_of_first(known: NDArray[np.float32], asked: NDArray[np.float32], sizes: list[int]) -> NDArray[np.int64]:
    """The nearest among the first known rows, for several numbers of them.

    Args:
        known: ``(n, D)``.
        asked: ``(m, D)``.
        sizes: how many known rows count, ascending, ``(S,)``.

    Returns:
        Indices of known rows, ``(S, m)``; of rows equally near the first.
    """
    squares = np.einsum("ij,ij->i", known, known)
    least, nearest = np.full(len(asked), np.inf, np.float32), np.zeros(len(asked), np.int64)
    found, begin = [], 0
    for size in sizes:
        for first in range(begin, size, 4096):
            rows = slice(first, min(first + 4096, size))
            distances = squares[rows] - 2.0 * asked @ known[rows].T  # and the same |asked|² for all
            best = distances.argmin(axis=1)
            here = np.take_along_axis(distances, best[:, None], axis=1)[:, 0]
            nearest = np.where(here < least, first + best, nearest)
            least = np.minimum(here, least)
        begin = size
        found.append(nearest)
    return np.stack(found)


def _seen(reading: Reading, seen: str) -> NDArray[np.float32]:
    """Rows whose distances compare touches: of probabilities Hellinger's."""
    return np.exp(reading.logits / 2).astype(np.float32) if seen == "probabilities" else reading.features


def _say(study: Study, numbers: dict[str, Any]) -> list[str]:
    probabilities, features = (numbers["neighbours"][seen] for seen in SEEN)
    return [
        "Why this estimator: the images are too fine for a bank to hold one like each, but the network reduces them to "
        "a few numbers. What it says holds for readers of these numbers, and is a guess for others.",
        f"{study.touches} fresh touches, each of another object, seed {study.seed}: the classifier reads "
        f"{words(numbers['classifier'])} of them right, and {words(numbers['learned_from'])} of those it learned from. "
        "The latter estimates from above what more touches could bring the same network.",
        f"The mean over all views that are as likely reads {words(numbers['all_views'])}, that is "
        f"{words(numbers['gain_of_views'], '+')} more: a better reader, as far as the interval says so.",
        f"The nearest known touch in the network's probabilities names {probabilities['nearest'][-1]:.4f} right, so "
        f"whoever reads these comes to {probabilities['upper'][-1]:.4f} at most; in its features it names "
        f"{features['nearest'][-1]:.4f}, whose readers come to {features['upper'][-1]:.4f}. With fewer known touches "
        "the bounds were as below; one that still rises has not settled, and is too low.",
    ]


def _grids(numbers: dict[str, Any]) -> list[Grid]:
    rows = [
        (seen, measure, *(f"{value:.3f}" for value in numbers["neighbours"][seen][name]))
        for seen in SEEN
        for name, measure in (("nearest", "nearest neighbour"), ("upper", "any reader, at most"))
    ]
    return [Grid("By known touches", ("in the network's", "right", *map(str, numbers["sizes"])), rows)]
