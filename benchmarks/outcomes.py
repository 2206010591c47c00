"""Measure the loss of return by planning with few outcomes.

Run: python benchmarks/outcomes.py                     (some minutes; --help for other scenes and sizes)

Touches are drawn in 96 outcomes of a scene's model, about which beliefs are exact. Plans use 4 to 48 outcomes.
"""

from __future__ import annotations

import argparse

import numpy as np
from deciders import play

from activetouch.sensor_files import fitted_model
from belief.statistics import paired_bootstrap
from experiments.sensor_choice import independent_sensor
from planners.point_based import PointBased

FINEST = 96


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["coarse", "paper"], help="of four shapes")
    parser.add_argument(
        "--outcomes", type=int, nargs="+", default=[12, 4, 8, 24, 48], help="the first is the reference"
    )
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print("| scene | outcomes | return | success | touches | over the first |")
    print("|---|---|---|---|---|---|")
    for scene in arguments.scenes:
        model = fitted_model(independent_sensor(scene), independent=True).model
        reference = np.empty(0)
        for number in arguments.outcomes:
            decider = PointBased(model.outcome_table(number))
            episodes, problem = play(model.outcome_table(FINEST), decider, arguments.episodes, arguments.seed)
            returns = np.array([episode.reward(problem) for episode in episodes])
            reference = reference if reference.size else returns
            over, low, high = paired_bootstrap(returns, reference, np.random.default_rng(arguments.seed))
            print(
                f"| {scene} | {number} | {returns.mean():.3f} ± {returns.std(ddof=1) / np.sqrt(len(returns)):.3f} "
                f"| {np.mean([episode.success for episode in episodes]):.3f} "
                f"| {np.mean([episode.num_touches for episode in episodes]):.2f} "
                f"| {over:+.4f} [{low:+.4f}, {high:+.4f}] |",
                flush=True,
            )


if __name__ == "__main__":
    main()
