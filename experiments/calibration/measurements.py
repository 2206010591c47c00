"""Measurements of a calibration report, and the calibration and model that cross-validation chose."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from belief.files import write_text
from experiments.calibration.models import ModelScores
from experiments.calibration.orientation import RankTest
from experiments.calibration.touches import RAW, TouchScores

Scores = TypeVar("Scores", TouchScores, ModelScores)


@dataclass(frozen=True)
class Measurements:
    """All numbers of a calibration report.

    Attributes:
        scene: name of the scene.
        seed: seed of all random numbers.
        confidence: posterior at which searches stop.
        num_objects: number of objects by split.
        num_rounds: number of rounds of all poses in which every object was touched.
        touches: scores by calibration, the raw softmax first.
        models: scores in the order of the registry of models, the model without a discount last.
        orientation: tests of the joint model's posterior of orientation and size; none without such a model.
        orientation_hypotheses: number of hypotheses of each shape in these tests; None for those of the model.
    """

    scene: str
    seed: int
    confidence: float
    num_objects: Mapping[str, int]
    num_rounds: int
    touches: Sequence[TouchScores]
    models: Sequence[ModelScores]
    orientation: Sequence[RankTest] = ()
    orientation_hypotheses: int | None = None

    def __str__(self) -> str:
        """The verdict, and the measured targets as tables."""
        from experiments.calibration.sections import verdict_section

        section = verdict_section(self)
        return "\n\n".join([*section.sentences, *(table.markdown() for table in section.tables)])

    def save(self, folder: Path) -> None:
        """Write ``report.html``, ``numbers.json``, ``tables.md`` and the figures into a folder.

        Raises:
            CannotWrite: The disk is full, or the folder is not writable.
        """
        from experiments.calibration.sections import sections  # loads matplotlib
        from experiments.reporting.page import write_page  # loads jinja2

        report = sections(self)
        write_page(folder / "report.html", f"Calibration in the scene “{self.scene}”", report)
        write_text(folder / "numbers.json", json.dumps(asdict(self), indent=1, default=np.ndarray.tolist) + "\n")
        tables = [table.markdown() for section in report for table in section.tables]
        write_text(folder / "tables.md", "\n\n".join(tables) + "\n")
        for picture in (picture for section in report for picture in section.pictures):
            picture.write(folder)

    @property
    def calibration(self) -> TouchScores:
        """The calibration with the lowest cross-validated NLL."""
        return _best(self.touches)

    @property
    def model(self) -> ModelScores:
        """The observation model with the lowest cross-validated NLL."""
        return _best(self.models)

    @property
    def raw(self) -> TouchScores:
        """The scores of the raw softmax."""
        return next(scores for scores in self.touches if scores.name == RAW)


def _best(candidates: Sequence[Scores]) -> Scores:
    """The candidate with the lowest cross-validated NLL, among those that have one."""
    return min((c for c in candidates if c.cross_validated_nll is not None), key=lambda c: c.cross_validated_nll or 0.0)
