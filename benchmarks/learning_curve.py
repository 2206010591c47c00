"""Accuracy on unseen objects against the number of images to learn from.

python -m benchmarks.learning_curve --scene gel --shares 0.0625 0.25 1
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from activetouch.data.dataset import TouchSet, read_split
from activetouch.data.manifest import SPLITS, Manifest
from activetouch.extras import require_extra
from activetouch.perception.recipe import RECIPES
from belief.claims import claim_folder, ends_claims
from belief.files import write_text
from belief.table import Table
from benchmarks.reader_scores import Scores, draw_errors, scores
from experiments.command_line.arguments import Jobs, NotEmpty, Pixels, Seed, Share, check_arguments
from experiments.parallel import default_jobs
from experiments.scene_choice import collection_folder, in_file_names, named_scene
from experiments.sensor.train import (
    STATE_FILE,
    BackboneName,
    Changes,
    card_for,
    new_classifier,
    require_input_size,
    run_to_the_end,
)
from experiments.sensor_choice import open_collection


@dataclass(frozen=True)
class Point:
    """One training.

    Attributes:
        images: of each shape that it learned from.
        epochs: passes over them.
        scores: on the test split.
    """

    images: int
    epochs: int
    scores: Scores


@dataclass(frozen=True)
class LearningCurve:
    """Train on parts of a collection, each with as many steps as the whole would get, and read the same test touches.

    Started again, it goes on after the last finished epoch.

    For example:

        python -m benchmarks.learning_curve --scene gel --shares 0.0625 0.25 1
    """

    scene: str = "gel"
    """Whose collection."""
    data: Path | None = None
    """Folder of the collection; data/SCENE by default."""
    shares: Annotated[tuple[Share, ...], NotEmpty()] = (1 / 64, 1 / 16, 1 / 4, 1.0)
    """Of the training split's objects, to learn from."""
    backbone: BackboneName = "cnn"
    """The network."""
    input_size: Pixels | None = None
    """Edge the images are brought to [pixels]; the scene's by default."""
    change: Changes = field(default_factory=Changes)
    """What to change about the recipe "large"; its epochs are those of the whole collection."""
    seed: Seed = 0
    """Of the intervals."""
    threads: Jobs = field(default_factory=default_jobs)
    """Threads of the linear algebra."""
    out: Path | None = None
    """Folder for states, numbers and figure; runs/learning-curve-SCENE by default."""

    @ends_claims
    def run(self) -> None:
        """Train, read, write and print."""
        check_arguments(self)
        require_extra("train")
        import torch

        out = self.out if self.out is not None else Path(f"runs/learning-curve-{in_file_names(self.scene)}")
        claim_folder(out)
        data = self.data if self.data is not None else collection_folder(self.scene)
        manifest = open_collection(data, self.scene, repeats=False)
        require_input_size(self._size, manifest.image_shape[0], self.backbone)
        torch.set_num_threads(self.threads)
        splits = {split: read_split(data, split) for split in SPLITS}
        points = [self._point(share, manifest, splits, out) for share in sorted(self.shares)]
        arguments = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(self).items()}
        numbers = {"arguments": arguments, "points": [asdict(point) for point in points]}
        write_text(out / "learning_curve.json", json.dumps(numbers, indent=1) + "\n")
        draw_learning_curve(points, f"scene {self.scene}, {self.backbone}", out / "learning_curve.svg")
        rows = [(p.images, p.epochs, str(p.scores), p.scores.nll) for p in points]
        headings = [("images per shape", "d"), ("epochs", "d"), "accuracy [95 %]", ("NLL", ".4f")]
        print(Table(f"{self.scene}, {self.backbone}", headings, rows))
        print(f"wrote {out}/learning_curve.json and .svg")

    @property
    def _size(self) -> int:
        return self.input_size if self.input_size is not None else named_scene(self.scene).input_size

    def _point(self, share: float, manifest: Manifest, splits: dict[str, TouchSet], out: Path) -> Point:
        from activetouch.perception.training import Trainer

        train, calibration, test = (splits[split] for split in SPLITS)
        objects = np.unique(train.object_ids)
        chosen = objects[: max(len(manifest.shape_labels), round(share * len(objects)))]  # shapes take turns in these
        part = train.select(np.isin(train.object_ids, chosen))
        recipe = self.change.of(RECIPES["large"])
        recipe = replace(recipe, epochs=max(1, round(recipe.epochs * len(train.images) / len(part.images))))
        card = card_for(part, self.backbone, self._size, manifest.shape_labels, manifest.pose_labels)
        state = out / f"{len(chosen)}-objects" / STATE_FILE
        classifier = new_classifier(card, recipe.seed)
        trainer = Trainer(classifier, recipe, part, calibration, state, manifest.symmetry)
        run_to_the_end(trainer)
        trainer.finish()
        result = scores(classifier, calibration, test, np.random.default_rng(self.seed))
        per_shape = len(part.images) // len(manifest.shape_labels)
        return Point(per_shape, trainer.epochs_done, result)


def draw_learning_curve(points: Sequence[Point], title: str, path: Path) -> None:
    """Draw the error with its interval against the number of images per shape.

    Args:
        points: trainings.
        title: above the figure.
        path: file to write; the ending decides the format.

    Raises:
        CannotWrite: there is no room, or no permission.
    """
    from matplotlib.ticker import NullFormatter

    from experiments.reporting.style import PALETTE, figure

    with figure((5.5, 3.6), path) as drawn:
        images = np.array([point.images for point in points])
        axes = drawn.subplots()
        error = draw_errors(axes, images, [point.scores for point in points], PALETTE[0])
        axes.plot(images, error, color=PALETTE[0], linewidth=1)
        axes.set(xlabel="images per shape", title=title)
        axes.set_xticks(images, [f"{number}" for number in images])
        axes.xaxis.set_minor_formatter(NullFormatter())


if __name__ == "__main__":
    tyro.cli(LearningCurve, config=(tyro.conf.OmitSubcommandPrefixes,)).run()
