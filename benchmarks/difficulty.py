"""What choosing the place of a touch is worth, by the difficulty of the scene: searches with the sensor of ``keyed``.

    python -m benchmarks.difficulty --searches 300 --out runs/difficulty          (some minutes each variant)

Every variant is a search among four objects, whose shapes are drawn independently from a list. All deciders play the
same searches and stop by the same rule. Draws ``difficulty.png``, again after each variant.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from activetouch import TactileSensor, TouchWorld
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.poses import POSE_SETS
from activetouch.rendering import Gain, Noise
from activetouch.sensor_files import MODELS
from activetouch.world import touch_many
from belief import SearchProblem, Touch
from belief.observation_model.outcome_mixture import Views
from belief.observation_model.rigid_body import RigidBodyModel
from belief.statistics import wilson_interval
from belief.synthetic import sample_arrangement
from benchmarks.choice import spread, with_places
from benchmarks.search_bound import RevealedBody, revealed_body
from planners import Decider, Episode, make_decider, search_lockstep
from planners.search import TouchRequest

CUBES = ("cube", "cube_cut", "cube_cut_twice", "cube_chamfered")
FAMILIES = (CUBES, ("shaft", "shaft_flat"), ("plate", "plate_boss"))
CHOSEN, RANDOM, FIXED, GIVEN_SHAPE = "chosen", "random", "best order", "given the shape"
_AT_ONCE = 50


@dataclass(frozen=True)
class Variant:
    """A scene of some difficulty.

    Attributes:
        shapes: that an object may have.
        places: number of directions.
        noise: of the sensor, relative to that of ``keyed``.
    """

    shapes: tuple[str, ...]
    places: int = 26
    noise: float = 1.0


VARIANTS: Mapping[str, Variant] = {
    "one of each family": Variant(tuple(family[0] for family in FAMILIES)),
    "all eight": Variant(sum(FAMILIES, ())),
    "shafts": Variant(FAMILIES[1]),
    "plates": Variant(FAMILIES[2]),
    "cubes": Variant(CUBES),
    "cube or cut cube": Variant(CUBES[:2]),
    "cubes, 6 places": Variant(CUBES, 6),
    "cubes, 98 places": Variant(CUBES, 98),
    "cubes, noise / 2": Variant(CUBES, noise=0.5),
    "cubes, noise × 2": Variant(CUBES, noise=2.0),
}


@dataclass(frozen=True, eq=False)
class SomeShapes:
    """Hypotheses about some of the shapes."""

    table: HypothesisTable
    shapes: NDArray[np.int64]

    @property
    def groups(self) -> tuple[int, ...]:
        """See :class:`HypothesisTable`."""
        return self.table.groups

    def __call__(self, num_hypotheses: int) -> NDArray[np.float32]:
        """See :class:`HypothesisTable`."""
        return self.table(num_hypotheses)[:, self.shapes]

    def in_pose(self, num_hypotheses: int, pose: int) -> NDArray[np.floating]:
        """See :class:`HypothesisTable`."""
        return self.table.in_pose(num_hypotheses, pose)[self.shapes]

    def views(self, num_hypotheses: int) -> Views:
        """See :class:`HypothesisTable`."""
        return self.table.views(num_hypotheses)


def prepared(sensor: TactileSensor, variant: Variant) -> tuple[TactileSensor, RigidBodyModel, NDArray[np.int64]]:
    """The sensor in the scene of a variant, its model of the variant's shapes, and which shapes these are."""
    faults = (Gain(0.10), Noise(0.02 * variant.noise))
    if variant.places == 6:
        scene = replace(sensor.scene, poses=POSE_SETS["mix"], faults=faults)
    elif variant.places == len(sensor.scene.poses):
        scene = replace(sensor.scene, faults=faults)
    else:
        scene = replace(sensor.scene, poses=spread(variant.places), faults=faults)
    sensor = with_places(sensor, scene)
    assert isinstance(sensor.model, RigidBodyModel)
    assert isinstance(sensor.model.hypotheses, HypothesisTable)
    shapes = np.array([scene.shape_labels.index(label) for label in variant.shapes])
    model = replace(
        sensor.model,
        shape_labels=variant.shapes,
        reference_logits=sensor.model.reference_logits[..., shapes],
        hypotheses=SomeShapes(sensor.model.hypotheses, shapes),
        conflict=None,
    )
    return sensor, model, shapes


class SomeObjects(TouchWorld):
    """Objects of the shapes of a variant."""

    shapes: NDArray[np.int64]

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shape of every object among those of the variant."""
        return tuple(int(np.flatnonzero(self.shapes == shape)[0]) for shape in super().arrangement)


def deciders(model: RigidBodyModel, variant: Variant, stop: str) -> Iterator[tuple[str, Decider]]:
    """The deciders of the comparison, by name."""
    table = model.outcome_table()
    names = {
        CHOSEN: f"shape_information_gain(hypotheses=128,outcomes=256,{stop})",
        RANDOM: f"random_poses({stop})",
        GIVEN_SHAPE: f"information_gain(given='shape',{stop})",
        **({FIXED: f"best_order({stop})"} if variant.places == 26 else {}),
    }
    for name, reference in names.items():
        yield name, make_decider(reference, table, model, MODELS / "keyed" / "policies")


def play(
    sensor: TactileSensor,
    model: RigidBodyModel,
    shapes: NDArray[np.int64],
    problem: SearchProblem,
    decider: Decider,
    searches: int,
    seed: int,
) -> list[Episode]:
    """Searches for each shape in turn; those of the same seed have the same objects, and a touch gives the same."""

    def touched(requests: Sequence[TouchRequest[SomeObjects]]) -> list[Touch]:
        found, _ = touch_many(sensor, requests)
        return [Touch(touch.pose, touch.logits[shapes], touch.features) for touch in found]

    episodes: list[Episode] = []
    for first in range(0, searches, _AT_ONCE):
        numbers = range(first, min(first + _AT_ONCE, searches))
        worlds = []
        for number in numbers:
            rng = np.random.default_rng([seed, number])
            arrangement = sample_arrangement(problem, rng)
            objects = [sensor.scene.sample_object(int(shapes[shape]), rng) for shape in arrangement]
            worlds.append(SomeObjects(sensor, objects))
            worlds[-1].shapes = shapes
        targets = [number % problem.num_shapes for number in numbers]
        episodes += search_lockstep(
            worlds, decider, problem, targets, model, [(seed, number) for number in numbers], touched
        )
    return episodes


@dataclass(frozen=True)
class Row:
    """Mean touches of a decider in a variant, and the fraction that chosen places save, with its 95 % interval."""

    variant: str
    decider: str
    touches: float
    fewer: float
    fewer_low: float
    fewer_high: float


def measure(sensor: TactileSensor, name: str, searches: int, seed: int, stop: str) -> list[Row]:
    """The rows of one variant."""
    variant = VARIANTS[name]
    inside, model, shapes = prepared(sensor, variant)
    labels = inside.scene.pose_labels
    problem = SearchProblem(variant.shapes, labels, 4, "independent", touch_limit=4 * 26)
    bounds = [revealed_body(problem, model, target) for target in range(problem.num_shapes)]
    bound = RevealedBody.over_targets(bounds)
    assert bound is not None, "touches cost something"
    rows: list[Row] = []
    chosen = np.zeros(0)
    for decider_name, decider in deciders(model, variant, stop):
        episodes = play(inside, model, shapes, problem, decider, searches, seed)
        touches = np.array([episode.num_touches for episode in episodes], float)
        chosen = chosen if chosen.size else touches
        right = sum(episode.success for episode in episodes)
        drawn = np.random.default_rng(seed).integers(searches, size=(2000, searches))
        shares = 1.0 - chosen[drawn].sum(axis=1) / touches[drawn].sum(axis=1)
        fewer = (float(1.0 - chosen.sum() / touches.sum()), *map(float, np.quantile(shares, [0.025, 0.975])))
        returns = float(np.mean([episode.reward(problem) for episode in episodes]))
        rates = (right / searches, *wilson_interval(right, searches))
        rows.append(Row(name, decider_name, float(touches.mean()), *fewer))
        print(
            f"{name:20} {decider_name:16} success {rates[0]:.3f} [{rates[1]:.3f}, {rates[2]:.3f}]  touches "
            f"{touches.mean():6.2f}  fewer {fewer[0]:6.1%} [{fewer[1]:.1%}, {fewer[2]:.1%}]  return {returns:.3f} of "
            f"at most {bound.mean:.3f} ± {1.96 * bound.standard_error:.3f}",
            flush=True,
        )
    return rows


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the share of touches saved in every variant, the variants where choosing pays most at the top."""
    saved = {(row.variant, row.decider): row for row in rows}
    variants = sorted({row.variant for row in rows}, key=lambda name: saved[name, RANDOM].fewer)
    drawn = Figure((8.5, 1.2 + 0.65 * len(variants)), layout="constrained")
    axes = drawn.add_subplot(xlabel="fewer touches with chosen places [%]")
    for number, decider in enumerate((RANDOM, GIVEN_SHAPE, FIXED)):
        some = [(y, saved[name, decider]) for y, name in enumerate(variants) if (name, decider) in saved]
        x = 100 * np.array([row.fewer for _, row in some])
        errors = 100 * np.array([[row.fewer - row.fewer_low, row.fewer_high - row.fewer] for _, row in some]).T
        y = np.array([y for y, _ in some]) + 0.18 * (1 - number)
        axes.errorbar(x, y, xerr=np.maximum(errors, 0.0), fmt="os^"[number], ms=5, lw=1, label=f"than {decider}")
    names = [f"{name}\n(random: {saved[name, RANDOM].touches:.1f} touches)" for name in variants]
    axes.set_yticks(range(len(variants)), names)
    axes.axvline(50.0, color="0.6", lw=1, ls="--")
    axes.grid(axis="x", alpha=0.3)
    axes.legend(loc="lower right")
    drawn.savefig(path, dpi=110)


def main() -> None:
    """Play, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--searches", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=list(VARIANTS))
    parser.add_argument("--stop", default="confirm=0.98,reject=0.02,max_touches=26", help="the stopping rule of all")
    parser.add_argument("--out", type=Path, default=Path("runs/difficulty"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    sensor, rows = TactileSensor.shipped("keyed"), list[Row]()
    for name in arguments.variants:
        rows += measure(sensor, name, arguments.searches, arguments.seed, arguments.stop)
        draw(rows, arguments.out / "difficulty.png")


if __name__ == "__main__":
    main()
