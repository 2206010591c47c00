"""The limit of force-patch images from below, by a reader of every pixel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.data.dataset import read_manifest, read_split
from activetouch.rendering import ForcePatchRenderer
from experiments.bayes_error.estimator import (
    Findings,
    Grid,
    Study,
    curve_cell,
    curve_heading,
    paired_difference,
    share,
    words,
)
from experiments.bayes_error.pixel_reader import PLACE, CloseReader, close_ups
from experiments.parallel import progress_bar
from experiments.sensor_choice import require_collection

_PARTS = (4, 2, 1)
WHOLE = "every pixel of the spot, its place, its brightness"
VIEWS: Mapping[str, slice] = {"its place and brightness": slice(-PLACE, None), WHOLE: slice(None)}
"""What a reader may see of a close-up."""


@dataclass(frozen=True)
class CloseUp:
    """A reader trained on full-resolution images of a collection."""

    collection: Path
    """Folder of the touches to learn from."""
    reader: CloseReader = field(default_factory=CloseReader)
    """The network, and how it is trained."""

    def measure(self, study: Study) -> Findings:
        """See :class:`experiments.bayes_error.estimator.Estimator`."""
        renderer = study.scene.renderer
        assert isinstance(renderer, ForcePatchRenderer), "the caller chose this scene for its renderer"
        manifest = read_manifest(self.collection)
        require_collection(self.collection, manifest, study.sensor.classifier.card, None, repeats=False)
        train = read_split(self.collection, "train")
        order = np.random.default_rng(study.seed).permutation(np.unique(train.object_ids))  # parts are of whole objects
        known, readings = close_ups(train.images, renderer), study.read()
        asked = close_ups(readings, renderer)
        classifier = study.classify(readings).argmax(axis=1) == study.shapes
        objects = [order[:size] for part in _PARTS if (size := len(order) // part)]
        parts = [np.isin(train.object_ids, some) for some in objects]
        views: dict[str, Any] = {}
        with progress_bar() as progress:
            total = self.reader.epochs * len(VIEWS) * sum(int(rows.sum()) for rows in parts)
            bar = progress.add_task("training readers", total=total)
            for name, columns in VIEWS.items():
                curve = []
                for rows in parts:
                    seen, shapes = known[rows, columns], train.shapes[rows]
                    read = self.reader.learn(seen, shapes, study.seed, lambda n: progress.advance(bar, n))
                    right = read(asked[:, columns]).argmax(axis=1) == study.shapes
                    curve.append(float(right.mean()))
                views[name] = {
                    **share(right),
                    "curve": curve,
                    "learned_from": float(np.mean(read(seen).argmax(axis=1) == shapes)),
                    "above_classifier": paired_difference(right, classifier, study.seed),
                }
        numbers: dict[str, Any] = {
            "estimator": "close-up",
            "sizes": [int(rows.sum()) for rows in parts],
            "views": views,
            "limit": {"at_least": views[WHOLE]["value"]},
            "classifier": share(classifier),
        }
        return Findings("What every pixel tells", _say(study, numbers), _grids(numbers), numbers)


def _say(study: Study, numbers: dict[str, Any]) -> list[str]:
    whole = numbers["views"][WHOLE]
    return [
        "Why this estimator: a force-patch image need not show all of the numbers it is drawn from, so a reader of the "
        "numbers bounds a reader of images from above only. This reader looks at the images, unresized, and bounds the "
        "limit from below.",
        f"{study.touches} fresh touches, each of another object, seed {study.seed}; {numbers['sizes'][-1]} known ones. "
        f"It reads {words(whole)} right, and {whole['learned_from']:.4f} of what it learned from. The classifier has "
        f"{words(numbers['classifier'])} on the same touches; the reader has {words(whole['above_classifier'], '+')} "
        "more.",
    ]


def _grids(numbers: dict[str, Any]) -> list[Grid]:
    rows = [
        (name, words(view), f"{view['learned_from']:.3f}", curve_cell(view["curve"]))
        for name, view in numbers["views"].items()
    ]
    rows.append(("the classifier", words(numbers["classifier"]), "", ""))
    headings = ("a reader that sees", "right", "of what it learned from", curve_heading(numbers["sizes"]))
    return [Grid("What a touch's pixels tell", headings, rows)]
