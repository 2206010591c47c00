"""Measurements of a calibration report, and the report: sentences, tables and figures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np

from belief.files import write_text
from belief.metrics import CalibrationError
from belief.table import Table
from experiments.calibration.models import UNDISCOUNTED, ModelScores
from experiments.calibration.touches import RAW, TouchScores
from experiments.reporting.page import Section

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
    """

    scene: str
    seed: int
    confidence: float
    num_objects: Mapping[str, int]
    num_rounds: int
    touches: Sequence[TouchScores]
    models: Sequence[ModelScores]

    def __str__(self) -> str:
        pieces = [[f"# {s.title}", *s.sentences, *(table.markdown() for table in s.tables)] for s in sections(self)]
        return "\n\n".join(chain.from_iterable(pieces))

    def save(self, folder: Path) -> None:
        """Write ``report.html``, ``numbers.json``, ``tables.md`` and the figures into a folder.

        Raises:
            CannotWrite: The disk is full, or the folder is not writable.
        """
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


def sections(found: Measurements) -> list[Section]:
    """All sections of the report, the verdict first."""
    return [_verdict(found), _touches(found), _fusion(found), _stops(found)]


def _verdict(found: Measurements) -> Section:
    """The errors of the chosen calibration and of the chosen model, beside those by chance."""
    one, (_, low, high) = found.calibration.report.ece_classwise, found.calibration.classwise
    worst = {kind: max(fused, key=lambda score: score.ece.value) for kind, fused in found.model.fused.items()}
    fused = "; ".join(f"{kind} {_error(s.ece)} after {s.num_touches}" for kind, s in worst.items())
    stopped = [
        f"{kind} {c.overall.mean_stated:.3f} and {c.overall.share_right:.3f}"
        for kind, scores in found.model.stops.items()
        if (c := scores.claims)
    ]
    sentences = [
        f"A touch, calibrated by {found.calibration.name}, has a mean calibration error over shapes of {_error(one)} "
        f"(bias-corrected 95 % interval [{low:.4f}, {high:.4f}]).",
        f"Fused by {found.model.name}, the largest error after any number of touches is: {fused}.",
        f"Stated confidence and accuracy at stopping: {'; '.join(stopped) or 'no search stopped'}.",
        "In brackets: the error by chance.",
    ]
    return Section("Verdict", [" ".join(sentences) + _without_discount(found), _what_was_measured(found)])


def _without_discount(found: Measurements) -> str:
    """Accuracy and stated confidence at stopping, with repeats assumed independent and with the chosen model."""
    naive = next(scores for scores in found.models if scores.name == UNDISCOUNTED)
    both = [scores.stops["one pose"].claims for scores in (naive, found.model)]
    words = [f"{c.overall.share_right:.3f} at a stated confidence of {c.overall.mean_stated:.3f}" for c in both if c]
    if len(words) < 2:
        return ""
    return (
        f" The accuracy of searches in one pose that assume independent touches is {words[0]}; with "
        f"{found.model.name} it is {words[1]}."
    )


def _what_was_measured(found: Measurements) -> str:
    known, test = found.num_objects["calibration"], found.num_objects["test"]
    sequences = ", ".join(f"{stopped.num_sequences} of {kind}" for kind, stopped in found.model.stops.items())
    return (
        f"Scene {found.scene}, seed {found.seed}. Models were fitted to {known} objects and measured on {test} others, "
        f"each touched in {found.num_rounds} rounds of all poses. Sequences: {sequences}; all have a uniform prior. "
        f"“{UNDISCOUNTED}” is the ratio model with touches in one pose assumed independent. The error by chance is the "
        "95 % quantile of the error of a perfectly calibrated model with the same predictions and independent labels. "
        "Errors of touches of one object are correlated, so the true quantile is larger; only intervals that resample "
        "objects account for this."
    )


def _touches(found: Measurements) -> Section:
    from experiments.calibration.figures import reliability  # loads matplotlib

    raw, calibrated = found.raw, found.calibration
    grid = Table(
        f"Single touches of the test split, {raw.report.num_rows} (in brackets: chance, or the 95 % interval)",
        (
            *("calibration", "NLL, cross-validated", "NLL", "Brier", "accuracy"),
            *("ECE", "ECE, equal mass", "smooth", "classwise", "classwise, bias-corrected"),
        ),
        [_touch_row(found, scores) for scores in found.touches],
    )
    sentence = (
        f"Calibrated by {calibrated.name}, which has the lowest cross-validated NLL, a touch has an NLL of "
        f"{calibrated.report.negative_log_likelihood:.4f} instead of {raw.report.negative_log_likelihood:.4f}, and a "
        f"calibration error of {calibrated.report.ece_width.value:.4f} instead of {raw.report.ece_width.value:.4f}."
    )
    curves = {scores.name: scores.report.curve for scores in (raw, calibrated)}
    return Section("A single touch", [sentence], [grid], [reliability(curves)])


def _touch_row(found: Measurements, scores: TouchScores) -> tuple[str, ...]:
    report, (estimate, low, high) = scores.report, scores.classwise
    return (
        _named(found, scores.name),
        _loss(scores),
        f"{report.negative_log_likelihood:.4f}",
        f"{report.brier:.4f}",
        f"{report.accuracy:.4f}",
        *map(_error, (report.ece_width, report.ece_mass, report.smooth, report.ece_classwise)),
        f"{estimate:.4f} [{low:.4f}, {high:.4f}]",
    )


def _fusion(found: Measurements) -> Section:
    tables = []
    for kind, of_chosen in found.model.fused.items():
        headings = ("model", "NLL, cross-validated", *(f"error after {fused.num_touches}" for fused in of_chosen))
        rows = [
            (_named(found, s.name), _loss(s), *(_error(fused.ece) for fused in s.fused[kind])) for s in found.models
        ]
        tables.append(Table(f"Calibration error by number of touches (chance), {kind}", headings, rows))
    last = "; ".join(
        f"{kind} after {fused[-1].num_touches} touch{'es' * (fused[-1].num_touches > 1)}: accuracy "
        f"{fused[-1].accuracy:.3f}, NLL {fused[-1].nll:.3f}, error {fused[-1].ece.value:.4f}"
        for kind, fused in found.model.fused.items()
    )
    sentences = [
        f"Cross-validation on whole objects of the calibration split chose {found.model.name}: the loss is the mean "
        "negative log posterior of the true shape after one touch, two, and so on; half of the sequences have touches "
        "in the order in which they were recorded, half stay in one pose.",
        f"{found.model.name}: {last}.",
    ]
    return Section("Touches fused", sentences, tables)


def _stops(found: Measurements) -> Section:
    from experiments.calibration.figures import claims  # loads matplotlib

    headings = ("model", "stops", "touches", "confidence", "accuracy", "Clopper-Pearson ≥", "objects resampled")
    tables = []
    for kind in found.model.stops:
        rows = []
        for scores in found.models:
            stopped, name = scores.stops[kind], _named(found, scores.name)
            if stopped.claims is None or stopped.right is None:
                rows.append((name, "0", *[""] * 5))
                continue
            every, (_, low, high) = stopped.claims.overall, stopped.right
            mean = sum(part.count * (part.num_touches or 0) for part in stopped.claims.by_num_touches) / every.count
            stops = (f"{every.count} of {stopped.num_sequences}", f"{mean:.2f}")
            rates = (f"{every.mean_stated:.4f}", f"{every.share_right:.4f}", f"{every.low:.4f}")
            rows.append((name, *stops, *rates, f"[{low:.4f}, {high:.4f}]"))
        tables.append(Table(f"Stops at {found.confidence:g}, {kind}", headings, rows))
    sentence = (
        f"A search that touches until a shape has a posterior of {found.confidence:g} stops where favourable noise and "
        "the model's confidence in it are greatest. The stated confidence must be right after few touches and after "
        "many, not only on average."
    )
    shown = list(dict.fromkeys([UNDISCOUNTED, "ratio", found.model.name]))
    return Section("Stopping", [sentence], tables, [claims(found.models, shown, found.confidence)])


def _named(found: Measurements, name: str) -> str:
    return f"{name} (chosen)" if name in (found.model.name, found.calibration.name) else name


def _loss(scores: TouchScores | ModelScores) -> str:
    return "" if scores.cross_validated_nll is None else f"{scores.cross_validated_nll:.4f}"


def _error(error: CalibrationError) -> str:
    return f"{error.value:.4f} ({error.null_quantile:.4f})"


def _best(candidates: Sequence[Scores]) -> Scores:
    """The candidate with the lowest cross-validated NLL, among those that have one."""
    return min((c for c in candidates if c.cross_validated_nll is not None), key=lambda c: c.cross_validated_nll or 0.0)
