"""Stated confidence and fraction right on unseen objects that differ within their category, in sets of many seeds.

    python -m benchmarks.recorded_categories --seeds 0 1 2 3 4 5 6 7

Ten categories of six objects with 60 touches each, of 20 features: an object lies 1.5 times as far from its category as
categories lie from each other, and touches scatter as much again. Sets are played as by ``activetouch recorded --task
categories --scenes 0 --rounds 2``. The stops of all sets are pooled; the interval resamples objects.
"""

from __future__ import annotations

import argparse

import numpy as np

from activetouch.recorded import RecordedTouches
from experiments.recorded.play import RANDOM
from experiments.recorded.recorded import recorded
from experiments.sensor.scores import accuracy_of_objects

CATEGORIES, OBJECTS, TOUCHES, FEATURES = 10, 6, 60, 20


def drawn(seed: int) -> RecordedTouches:
    """A set whose objects differ within their category."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(CATEGORIES, FEATURES))
    away = 1.5 * rng.normal(size=(CATEGORIES, OBJECTS, FEATURES))
    scattered = 1.5 * rng.normal(size=(CATEGORIES, OBJECTS, TOUCHES, FEATURES))
    rows = (means[:, None, None] + away[:, :, None] + scattered).reshape(-1, FEATURES)
    kinds, things, sessions = (axis.ravel() for axis in np.indices((CATEGORIES, OBJECTS, TOUCHES)))
    names = [f"{kind}_{thing}" for kind in range(CATEGORIES) for thing in range(OBJECTS)]
    labels = {"categories": tuple(name.split("_")[0] for name in names)}
    objects = OBJECTS * kinds + things
    return RecordedTouches(rows, 0 * objects, objects, sessions, ("touch",), tuple(names), kinds=labels)


def line(name: str, found: np.ndarray) -> str:
    """Number of identifications that stopped, what they stated, and how many were right; ``found (n, 4)``."""
    stops = found[found[:, 1] == 1.0]
    if not len(stops):
        return f"{name}: no stop of {len(found)}"
    right, low, high = accuracy_of_objects(stops[:, 3], stops[:, 0], np.random.default_rng(0))
    share = f"right {right:.3f} [{low:.3f}, {high:.3f}]"
    where = f"{len(stops)} stops of {len(np.unique(stops[:, 0]))} objects"
    every = f"all {len(found)}: stated {found[:, 2].mean():.3f}, right {found[:, 3].mean():.3f}"
    return f"{name}: {where}: stated {stops[:, 2].mean():.3f}, {share}; {every}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--threshold", type=float, default=0.9)
    parser.add_argument("--touches", type=int, default=12)
    given = parser.parse_args()
    pooled = []
    for seed in given.seeds:
        settings = {"threshold": given.threshold, "max_touches": given.touches}
        report = recorded(drawn(seed), "categories", scenes=0, rounds=2, **settings)
        named = [one for one in report.named if one.decider == RANDOM]
        rows = [(1000 * seed + n.object_index, n.result.is_certain, n.result.stated, n.result.is_right) for n in named]
        pooled.append(np.array(rows, np.float64))
        print(line(f"set {seed}", pooled[-1]), flush=True)
    print(line("all sets", np.concatenate(pooled)))


if __name__ == "__main__":
    main()
