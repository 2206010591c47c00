"""Bounds on the accuracy of one touch from the outputs of a trained network, on its training and on held-out touches.

* Training accuracy: an upper estimate of the accuracy of this network with any number of training touches, provided
  that its training converged.
* Accuracy of the mean over rotated and mirrored views: where these are equally likely, the mean is a better reader of
  the same images, so this accuracy is attainable.
* Nearest-neighbour accuracy in the network's probabilities and in its features: bounds every reader of the same
  numbers, given enough known touches (Cover and Hart 1967). Readers that see more in the images are not bounded.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from activetouch.data.dataset import read_manifest, read_split
from activetouch.perception.reader import ImageReader, Reading
from activetouch.scene import Symmetry
from experiments.bayes_error.estimator import Findings, LimitStudy, paired_difference, share, words
from experiments.bayes_error.image_bank import symmetric_views
from experiments.parallel import progress_bar
from experiments.reporting.tables import Table
from experiments.sensor.scores import accuracy_of_objects
from experiments.sensor_choice import require_collection

_AT_ONCE = 256
_PARTS = (16, 8, 4, 2, 1)
SEEN = ("probabilities", "features")
"""The outputs of a network in which nearest neighbours are searched."""


@dataclass(frozen=True)
class LearnedBounds:
    """Estimator that reads a collection and held-out touches with the classifier and compares the two."""

    collection: Path
    """Folder of the touches that the classifier was trained on."""

    def measure(self, study: LimitStudy) -> Findings:
        """See :class:`experiments.bayes_error.estimator.Estimator`."""
        reader, symmetry = study.sensor.reader, study.scene.symmetry
        manifest = read_manifest(self.collection)
        require_collection(self.collection, manifest, reader.card, None, repeats=False)
        learned = read_split(self.collection, "train")
        known = read_views(reader, learned.images, Symmetry.NONE, "reading training touches")
        readings = study.read()
        asked = read_views(reader, readings, Symmetry.NONE, "reading held-out touches")
        turned = read_views(reader, readings, symmetry, "reading all their views")
        right, views_right = asked.labels == study.shapes, turned.labels == study.shapes
        fitted, *interval = accuracy_of_objects(
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
            "estimator": "learned bounds",
            "classifier": share(right),
            "learned_from": {"value": fitted, "interval": interval},
            "all_views": share(views_right),
            "gain_of_views": paired_difference(views_right, right, study.seed),
            "sizes": sizes,
            "neighbours": neighbours,
        }
        return Findings("Bounds from the trained network", _say(study, numbers), _tables(numbers), numbers)


def read_views(reader: ImageReader, images: NDArray[np.uint8], symmetry: Symmetry, what: str) -> Reading:
    """Mean log probabilities (in place of logits), features and embeddings over all equally likely views of each image.

    Args:
        reader: of the images.
        images: ``(N, H, W)`` or ``(N, H, W, 3)``.
        symmetry: which rotations and reflections are equally likely.
        what: text of the progress bar.
    """
    log_probs, features, embeddings = [], [], []
    with progress_bar() as progress:
        bar = progress.add_task(what, total=len(images))
        for first in range(0, len(images), _AT_ONCE):
            views = symmetric_views(images[first : first + _AT_ONCE], symmetry)
            found = reader.read(views.reshape(-1, *views.shape[2:]), _AT_ONCE)
            log_probs.append(log_softmax(found.logits, axis=1).reshape(*views.shape[:2], -1).mean(axis=1))
            features.append(found.features.reshape(*views.shape[:2], -1).mean(axis=1))
            embeddings.append(found.embeddings.reshape(*views.shape[:2], -1).mean(axis=1))
            progress.advance(bar, len(views))
    return Reading(np.concatenate(log_probs), np.concatenate(features), np.concatenate(embeddings))


def nearest_of_first(known: NDArray[np.float32], asked: NDArray[np.float32], sizes: list[int]) -> NDArray[np.int64]:
    """Index of the nearest known row, among the first ``s`` rows for every ``s`` in ``sizes``.

    Args:
        known: ``(n, D)``.
        asked: ``(m, D)``.
        sizes: numbers of known rows, ascending, ``(S,)``.

    Returns:
        ``(S, m)``; of equally near rows the first.
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


def cover_hart_accuracy(nearest: float, num_shapes: int) -> float:
    """Largest accuracy that any reader can have, given that of the nearest of infinitely many known touches.

    With K shapes, the error e of the nearest neighbour and the least possible error e* satisfy
    e ≤ e* (2 - e* K / (K - 1)) (Cover and Hart 1967).

    >>> cover_hart_accuracy(1.0, 4), cover_hart_accuracy(0.25, 4)
    (1.0, 0.25)
    """
    share = (num_shapes - 1) / num_shapes
    return 1.0 - share * (1.0 - float(np.sqrt(max(0.0, 1.0 - (1.0 - nearest) / share))))


def _seen(reading: Reading, seen: str) -> NDArray[np.float32]:
    """Rows to compare touches by; for probabilities, so that distances are Hellinger distances."""
    return np.exp(reading.logits / 2).astype(np.float32) if seen == "probabilities" else reading.features


def _say(study: LimitStudy, numbers: dict[str, Any]) -> list[str]:
    probabilities, features = (numbers["neighbours"][seen] for seen in SEEN)
    return [
        "Why this estimator: the images are too fine for a bank of ideal images, but the network reduces them to a few "
        "numbers. The bounds hold for readers of these numbers; for other readers they are estimates.",
        f"{study.touches} held-out touches, each of another object, seed {study.seed}: the classifier reads "
        f"{words(numbers['classifier'])} of them correctly, and {words(numbers['learned_from'])} of its training "
        "touches. The latter is an upper estimate of its accuracy with more training touches.",
        f"The mean over all equally likely views has accuracy {words(numbers['all_views'])}, "
        f"{words(numbers['gain_of_views'], '+')} more than one view.",
        f"The nearest known touch in the network's probabilities is correct for {probabilities['nearest'][-1]:.4f} of "
        f"the touches, so no reader of the probabilities exceeds {probabilities['upper'][-1]:.4f}; in its features it "
        f"is correct for {features['nearest'][-1]:.4f}, so no reader of the features exceeds "
        f"{features['upper'][-1]:.4f}. The table gives the bounds with fewer known touches: a bound that still rises "
        "has not converged and is too low.",
    ]


def _tables(numbers: dict[str, Any]) -> list[Table]:
    rows = [
        (seen, measure, *(f"{value:.3f}" for value in numbers["neighbours"][seen][name]))
        for seen in SEEN
        for name, measure in (("nearest", "nearest neighbour"), ("upper", "upper bound for any reader"))
    ]
    return [Table("Accuracy by number of known touches", ("output", "reader", *map(str, numbers["sizes"])), rows)]
