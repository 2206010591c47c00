"""Measurements of a calibration report, on sequences of touches, and the report: sentences, tables and a figure."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet
from activetouch.envs.touch_bank import TouchRounds
from belief.metrics import (
    CalibrationAtStop,
    CalibrationError,
    CalibrationReport,
    accuracy,
    calibration_at_stop,
    expected_calibration_error,
    negative_log_likelihood,
    null_quantile,
)
from belief.observation_model.model import ArrayModel
from belief.observation_model.selection import log_posteriors_by_touch
from belief.statistics import cluster_bootstrap
from belief.statistics.stop_thresholds import CandidateStops
from belief.table import Table, Value
from belief.touch_batch import TouchBatch
from experiments.report import Report, Reported, Section

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rounds(TouchRounds):
    """Touches of a split, from which sequences are drawn; a joint model needs the ``features (N, R, P, F)``."""

    logits: Floats
    features: NDArray[np.floating] | None = None

    @classmethod
    def of(cls, truth: TouchSet, touches: TouchBatch, num_poses: int) -> Rounds:
        """Rounds of a split, from ``touches`` in one sequence that is ordered by object, round and pose."""
        by_object = (len(np.unique(truth.object_ids)), -1, num_poses)
        each = len(truth.object_ids) // by_object[0]
        return cls(
            touches.require_logits().reshape(*by_object, touches.num_shapes),
            truth.shapes[::each],
            None if touches.features is None else touches.features.reshape(*by_object, touches.features.shape[2]),
        )

    def distinct_poses(self, rng: np.random.Generator) -> Sequences:
        """R sequences per object, which share no touch: every pose once, in random order, from random rounds."""
        poses = rng.permuted(np.tile(np.arange(self.num_poses), (self.num_objects, self.num_rounds, 1)), axis=2)
        rounds = np.take_along_axis(self._shuffled_rounds(rng).swapaxes(1, 2), poses, axis=2)  # (N, R, P)
        return self._pick(rounds, poses)

    def one_pose(self, rng: np.random.Generator) -> Sequences:
        """P sequences per object, one for each pose: R touches in this pose, rounds in random order."""
        rounds = self._shuffled_rounds(rng)  # (N, P, R)
        return self._pick(rounds, np.broadcast_to(np.arange(self.num_poses)[:, None], rounds.shape))

    def _shuffled_rounds(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Rounds in random order for every object and pose, ``(N, P, R)``."""
        return rng.permuted(np.tile(np.arange(self.num_rounds), (self.num_objects, self.num_poses, 1)), axis=2)

    def _pick(self, rounds: NDArray[np.int64], poses: NDArray[np.int64]) -> Sequences:
        """Sequences from rounds and poses ``(N, sequences, touches)``."""
        where, length = (np.arange(self.num_objects)[:, None, None], rounds, poses), poses.shape[2]
        logits, features = self.logits[where].reshape(-1, length, self.logits.shape[3]), self.features
        if features is not None:
            features = features[where].reshape(-1, length, features.shape[3])
        object_ids = np.arange(self.num_objects).repeat(poses.shape[1])
        return Sequences(TouchBatch(poses.reshape(-1, length), logits, features), self.shapes[object_ids], object_ids)


@dataclass(frozen=True, eq=False)
class Sequences:
    """S sequences of n touches, each of one object; ``shapes (S,)`` are true, ``object_ids (S,)`` are numbers."""

    batch: TouchBatch
    shapes: NDArray[np.int64]
    object_ids: NDArray[np.int64]


KINDS: Mapping[str, Callable[[Rounds, np.random.Generator], Sequences]] = {
    "distinct poses": Rounds.distinct_poses,
    "one pose": Rounds.one_pose,
}
"""Ways to choose the poses of a sequence, by name."""


RAW, DEFAULT = "raw softmax", "structured_matrix"
"""Names of the classifier's softmax and of the default calibration."""
UNDISCOUNTED = "independent"
"""Name of the ratio model without its discount, which takes touches in one pose as independent."""
_PREFERRED = ("rigid body", "ratio")  # whose numbers the verdict states, the first that was fitted
_FUSED = 6  # largest number of touches with scores
_NULL_RESAMPLES = 200


@dataclass(frozen=True)
class Fused:
    """Scores of the posterior after a number of touches of one kind of sequence, under a uniform prior."""

    num_touches: int
    accuracy: float
    nll: float
    ece: CalibrationError


@dataclass(frozen=True)
class ModelScores:
    """Scores of a model by kind of sequence: after 1, 2, … touches, and at stopping (None if no sequence stopped)."""

    name: str
    fused: Mapping[str, Sequence[Fused]]
    stops: Mapping[str, CalibrationAtStop | None]


def score_model(
    name: str, model: ArrayModel, sequences: Mapping[str, Sequences], confidence: float, rng: np.random.Generator
) -> ModelScores:
    """Scores of a fitted model by number of touches and at stopping, for every kind of sequence."""
    fused: dict[str, list[Fused]] = {}
    stopped: dict[str, CalibrationAtStop | None] = {}
    for kind, of_kind in sequences.items():
        log_probs, shapes = log_posteriors_by_touch(model, of_kind.batch), of_kind.shapes
        fused[kind] = []
        for number, probs in enumerate(np.exp(log_probs[:, :_FUSED]).swapaxes(0, 1), 1):
            chance = null_quantile(probs, expected_calibration_error, rng, num_resamples=_NULL_RESAMPLES)
            error = CalibrationError(expected_calibration_error(probs, shapes), chance)
            nll = negative_log_likelihood(probs, shapes)
            fused[kind].append(Fused(number, accuracy(probs, shapes), nll, error))
        found = CandidateStops.of_posteriors(log_probs, shapes)
        rows = found.stops([confidence])
        stopped[kind] = None
        if len(rows):
            scores = found.probs[rows], ~found.is_wrong[rows], found.touches[rows]
            score = calibration_at_stop(*scores)
            objects = of_kind.object_ids[found.searches[rows]]  # several sequences of one object err alike
            _, low, high = cluster_bootstrap(scores[1].astype(float), objects, rng)
            whole = replace(score.overall, low=min(low, score.overall.low), high=max(high, score.overall.high))
            stopped[kind] = replace(score, overall=whole)
    return ModelScores(name, fused, stopped)


@dataclass(frozen=True)
class Measurements(Reported):
    """All numbers of a calibration report.

    Attributes:
        confidence: posterior at which searches stop.
        num_rounds: number of rounds of all poses in which every object was touched.
        touches: scores and calibration errors of single touches by calibration, the raw softmax first.
        models: scores in the order of the registry of models, the model without a discount last.
    """

    scene: str
    seed: int
    confidence: float
    num_objects: Mapping[str, int]
    num_rounds: int
    touches: Mapping[str, CalibrationReport]
    models: Sequence[ModelScores]

    def report(self) -> Report:
        """The verdict first; ``numbers.json`` has all numbers."""
        sections = [_verdict(self), _touches(self), _fusion(self), _stops(self)]
        files = {"numbers.json": json.dumps(asdict(self), indent=1, default=np.ndarray.tolist) + "\n"}
        return Report(f"Calibration in the scene “{self.scene}”", sections, markdown="tables.md", files=files)

    @property
    def model(self) -> ModelScores:
        """Scores of the model that sensors ship with: the rigid body if it could be fitted, otherwise the ratio."""
        return min((m for m in self.models if m.name in _PREFERRED), key=lambda m: _PREFERRED.index(m.name))


def _panel(name: str, report: CalibrationReport) -> Callable[[Axes], None]:
    def draw(axes: Axes) -> None:
        report.curve.plot(axes)
        axes.set_title(name)

    return draw


def _verdict(found: Measurements) -> Section:
    worst = {kind: max(fused, key=lambda score: score.ece.value) for kind, fused in found.model.fused.items()}
    fused = "; ".join(f"{kind} {_error(s.ece)} after {s.num_touches}" for kind, s in worst.items())
    sentences = [
        f"A touch, calibrated by {DEFAULT}, has a mean calibration error over shapes of "
        f"{_error(found.touches[DEFAULT].ece_classwise)}.",
        f"Fused by {found.model.name}, the largest error after any number of touches is: {fused}.",
    ]
    for scores in (found.model, found.models[-1]):
        stopped = [
            f"{kind} {c.overall.mean_stated:.3f} and {c.overall.share_right:.3f}"
            for kind, c in scores.stops.items()
            if c
        ]
        stated = "; ".join(stopped) or "no search stopped"
        sentences.append(f"Stated confidence and accuracy at stopping with {scores.name}: {stated}.")
    kinds = ", ".join(found.model.fused)
    measured = (
        f"Scene {found.scene}, seed {found.seed}. Models were fitted to {found.num_objects['calibration']} objects and "
        f"measured on {found.num_objects['test']} others, each touched in {found.num_rounds} rounds of all poses. "
        f"Sequences: {kinds}; all have a uniform prior. “{UNDISCOUNTED}” is the ratio model with touches in one pose "
        "assumed independent. In brackets: the error by chance, the 95 % quantile of the error of a perfectly "
        "calibrated model with the same predictions and independent labels. Errors of touches of one object are "
        "correlated, so the true quantile is larger."
    )
    return Section("Verdict", [" ".join(sentences), measured])


def _touches(found: Measurements) -> Section:
    from experiments.report import Picture  # loads matplotlib

    picture = Picture(
        "reliability",
        "Accuracy of touches by their confidence. A calibrated model's points lie in the grey bars 95 % of the "
        "time (if touches are independent); the area of a point shows its fraction of the touches.",
        [_panel(name, found.touches[name]) for name in (RAW, DEFAULT)],
    )
    raw, default = found.touches[RAW], found.touches[DEFAULT]
    rows: list[tuple[Value, ...]] = [
        (
            name,
            *(scores.negative_log_likelihood, scores.brier, scores.accuracy),
            *map(_error, (scores.ece_width, scores.ece_mass, scores.smooth, scores.ece_classwise)),
        )
        for name, scores in found.touches.items()
    ]
    numbers = [(name, ".4f") for name in ("NLL", "Brier", "accuracy")]
    columns = ["calibration", *numbers, "ECE", "ECE, equal mass", "smooth", "classwise"]
    sentence = (
        f"Calibrated by {DEFAULT}, a touch has an NLL of {default.negative_log_likelihood:.4f} instead of "
        f"{raw.negative_log_likelihood:.4f}, and a calibration error of {default.ece_width.value:.4f} instead of "
        f"{raw.ece_width.value:.4f}."
    )
    title = f"Single touches of the test split, {raw.num_rows} (in brackets: chance)"
    return Section("A single touch", [sentence], [Table(title, columns, rows, name="touches")], [picture])


def _fusion(found: Measurements) -> Section:
    tables = []
    for kind, each in found.model.fused.items():
        last = f"NLL after {each[-1].num_touches}"
        columns = ["model", (last, ".4f"), *(f"error after {fused.num_touches}" for fused in each)]
        rows: list[tuple[Value, ...]] = [
            (s.name, s.fused[kind][-1].nll, *(_error(fused.ece) for fused in s.fused[kind])) for s in found.models
        ]
        title, name = f"Calibration error by number of touches (chance), {kind}", f"fused_{kind.replace(' ', '_')}"
        tables.append(Table(title, columns, rows, name=name))
    return Section("Touches fused", [], tables)


def _stops(found: Measurements) -> Section:
    tables = []
    for kind in found.model.stops:
        rows: list[tuple[Value, ...]] = []
        for scores in found.models:
            if (stopped := scores.stops[kind]) is None:
                rows.append((scores.name, 0, *[None] * 4))
                continue
            every = stopped.overall
            mean = sum(part.count * (part.num_touches or 0) for part in stopped.by_num_touches) / every.count
            rows.append((scores.name, every.count, mean, every.mean_stated, every.share_right, (every.low, every.high)))
        numbers = [("touches", ".2f"), ("confidence", ".4f"), ("accuracy", ".4f"), ("95 %", ".4f")]
        name, columns = f"stops_{kind.replace(' ', '_')}", ["model", ("stops", "d"), *numbers]
        tables.append(Table(f"Stops at {found.confidence:g}, {kind}", columns, rows, name=name))
    sentence = (
        f"A search that touches until a shape has a posterior of {found.confidence:g} stops where favourable noise and "
        "the model's confidence in it are greatest. The stated confidence must be right after few touches and after "
        "many, not only on average. The interval is the wider of Clopper and Pearson's and of a bootstrap over objects."
    )
    return Section("Stopping", [sentence], tables)


def _error(error: CalibrationError) -> str:
    return f"{error.value:.4f} ({error.null_quantile:.4f})"
