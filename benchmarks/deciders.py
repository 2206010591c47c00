"""Compare all deciders on the same searches: return, success, touches, and time per decision.

Run: python benchmarks/deciders.py                     (about an hour on one core; --help for shorter runs)

Outcomes are drawn from the table with which the deciders plan (a random one, or that of scene ``coarse``), so beliefs
are exactly right and the bounds hold. Tree search, which takes seconds per decision, plays only the first searches and
is compared with ``point_based`` on these. Writes CSV and a figure.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tabular_model import TabularModel
from timed import Timed

from activetouch.sensor_files import fitted_model
from belief import SearchProblem
from belief.observation_model import OutcomeTable
from belief.statistics import paired_bootstrap, wilson_interval
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from experiments.sensor_choice import independent_sensor
from planners import DECIDERS, Decider, Episode, make_decider, search_lockstep
from planners.registry import NEED_FILES
from planners.solve import SearchTouchProblem, solve

NUM_OBJECTS, TOUCH_COST = 4, 0.02
TREES = ("pouct",)


@dataclass(frozen=True)
class Row:
    """Results of one decider; intervals are 95 %."""

    model: str
    decider: str
    episodes: int
    mean_return: float
    return_std_error: float
    success: float
    success_low: float
    success_high: float
    touches: float
    ms_per_decision: float
    over_point_based: float
    over_low: float
    over_high: float


def tables() -> dict[str, OutcomeTable]:
    coarse = fitted_model(independent_sensor("coarse"), independent=True).model
    return {"coarse": coarse.outcome_table(), "random": random_model(np.random.default_rng(3)).outcome_table()}


def deciders(table: OutcomeTable, episodes: int, trees: Sequence[int]) -> list[tuple[str, int, Callable[[], Decider]]]:
    """Name, number of episodes and builder of each decider that needs no trained policies."""
    found: list[tuple[str, int, Callable[[], Decider]]] = [
        (name, episodes, lambda name=name: make_decider(name, table))
        for name in ("point_based", *(n for n in DECIDERS if n not in (*NEED_FILES, *TREES, "point_based")))
    ]
    for simulations, number in zip((100, 1000, 10_000), trees, strict=True):
        for name in TREES:
            found.append(
                (f"{name} {simulations}", number, lambda n=name, s=simulations: make_decider(n, table, simulations=s))
            )
    found.append(("pouct 1000, random rollouts", trees[1], lambda: with_random_rollouts(table)))
    return [entry for entry in found if entry[1]]


def with_random_rollouts(table: OutcomeTable) -> Decider:
    from planners.pomdp_py_adapter import InformedRollout, Pouct  # pomdp-py may not be installed

    class RandomRollout(InformedRollout):
        def rollout(self, state: object, history: tuple[object, ...]) -> object:
            return self.sample(state)

    return Pouct(table, 1000, RandomRollout)


def play(table: OutcomeTable, decider: Decider, episodes: int, seed: int) -> tuple[list[Episode], SearchProblem]:
    labels = tuple(f"shape_{k}" for k in range(table.num_shapes))
    model = TabularModel(labels, table)
    poses = tuple(f"pose_{p}" for p in range(table.num_poses))
    problem = SearchProblem(labels, poses, NUM_OBJECTS, touch_cost=TOUCH_COST, touch_limit=12 * NUM_OBJECTS)
    seeds = [(seed, number) for number in range(episodes)]
    worlds = [SyntheticWorld(model, sample_arrangement(problem, np.random.default_rng([*key, 2]))) for key in seeds]
    targets = [number % table.num_shapes for number in range(episodes)]
    return search_lockstep(worlds, decider, problem, targets, model, seeds), problem


def measure(name: str, table: OutcomeTable, arguments: argparse.Namespace) -> list[Row]:
    rows, reference = [], np.empty(0)
    for label, number, make in deciders(table, arguments.episodes, arguments.trees):
        timed = Timed(make())
        episodes, problem = play(table, timed, number, arguments.seed)
        returns = np.array([episode.reward(problem) for episode in episodes])
        reference = reference if reference.size else returns
        over, low, high = paired_bootstrap(returns, reference[:number], np.random.default_rng(arguments.seed))
        right = sum(episode.success for episode in episodes)
        mean, error = float(returns.mean()), float(returns.std(ddof=1) / np.sqrt(number))
        success, touches = (right / number, *wilson_interval(right, number)), [one.num_touches for one in episodes]
        milliseconds = float(np.median(np.concatenate(list(timed.milliseconds.values()))))
        row = Row(name, label, number, mean, error, *success, float(np.mean(touches)), milliseconds, over, low, high)
        rows.append(row)
        print(
            f"{label:28}{number:6}{row.mean_return:8.3f} ± {row.return_std_error:.3f}{row.success:8.3f}"
            f"{row.touches:8.2f}{row.ms_per_decision:10.3f}   {over:+.3f} [{low:+.3f}, {high:+.3f}]",
            flush=True,
        )
    return rows


def bounds(table: OutcomeTable) -> tuple[float, float]:
    """Certified lower and upper bound on the optimal return, mean over targets."""
    targets = range(table.num_shapes)
    plans = [solve(SearchTouchProblem(table.probs, NUM_OBJECTS, "distinct", each, TOUCH_COST)) for each in targets]
    return float(np.mean([plan.lower_bound for plan in plans])), float(np.mean([plan.upper_bound for plan in plans]))


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw a row of panels per table: return against ``point_based``, success, touches, time per decision."""
    models = list(dict.fromkeys(row.model for row in rows))
    drawn = Figure(figsize=(12, 5 * len(models)), layout="constrained")
    axes = drawn.subplots(len(models), 4, squeeze=False)
    for (over, success, touches, time_), model in zip(axes, models, strict=True):
        some = [row for row in rows if row.model == model][::-1]
        names = [f"{row.decider} ({row.episodes})" for row in some]
        for y, row in enumerate(some):
            over.plot([row.over_low, row.over_high], [y, y], "C0-", lw=1)
            over.plot(row.over_point_based, y, "C0o", ms=4)
            success.plot([row.success_low, row.success_high], [y, y], "C0-", lw=1)
            success.plot(row.success, y, "C0o", ms=4)
        touches.barh(range(len(some)), [row.touches for row in some], height=0.5)
        time_.plot([row.ms_per_decision for row in some], range(len(some)), "C0o", ms=4)
        over.axvline(0.0, color="0.7", lw=1, zorder=0)
        over.set_xscale("symlog", linthresh=0.05, linscale=1.5)
        over.set(yticks=range(len(some)), yticklabels=names, xlabel="return over point_based, paired, 95 %")
        over.set_xticks([-1, -0.1, -0.05, -0.02, 0, 0.02, 0.05], ["-1", "-0.1", "", "-0.02", "0", "0.02", "0.05"])
        over.set_title(f"table: {model} (number of searches)", loc="left")
        success.set(yticks=[], xlabel="success, 95 %", xlim=(0.0, 1.02))
        touches.set(yticks=[], xlabel="touches per search")
        time_.set(yticks=[], xscale="log", xlabel="processor time per decision [ms]")
        for axis in (over, success, touches, time_):
            axis.set_ylim(-0.6, len(some) - 0.4)
            axis.grid(axis="x", alpha=0.3)
    drawn.savefig(path, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=2000, help="searches per decider, except tree search")
    parser.add_argument(
        "--trees", type=int, nargs=3, default=(200, 100, 20), help="tree searches with 100, 1 000, 10 000 simulations"
    )
    parser.add_argument("--models", nargs="+", default=["coarse", "random"], choices=["coarse", "random"])
    parser.add_argument("--no-bounds", action="store_true", help="do not compute the bounds on the optimum")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/deciders"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for name in arguments.models:
        print(f"\ntouches drawn from the table: {name}")
        print(f"{'decider':28}{'n':>6}{'return':>16}{'success':>8}{'touches':>8}{'ms':>10}   over point_based")
        rows += measure(name, tables()[name], arguments)
        if not arguments.no_bounds:
            print("the optimum returns between {:.3f} and {:.3f}".format(*bounds(tables()[name])), flush=True)
        with (arguments.out / "deciders.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, [field.name for field in fields(Row)])
            writer.writeheader()
            writer.writerows(asdict(row) for row in rows)
        draw(rows, arguments.out / "deciders.svg")


if __name__ == "__main__":
    main()
