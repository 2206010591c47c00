"""Objects of mesh files, named by a sensor that is not as described: how many rightly, wrongly, or as none of these.

    python -m benchmarks.changed_meshes build/files --objects 40 --seed 3

Prints a row for each condition of ``robustness``: a name counts at a stated probability of 0.95, after at most 16
touches. The belief knows nothing of the condition.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from belief.naming import NONE_OF_THESE, UNLISTED
from belief.statistics import wilson_interval
from belief.table import Table
from experiments.meshes.identify import identify

WORLDS = (
    None,
    "noise × 3",
    "1 % stuck",
    "5 % stuck",
    "force 0.3 to 1 N",
    "stiffness × 0.4",
    "blurred by 5 pixels",
    "shifted by 4 pixels",
    "hysteresis 10 %",
)


def main() -> None:
    """Play and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--objects", type=int, default=40)
    parser.add_argument("--sensor", default="gel")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    given, rows = parser.parse_args(), []
    for world in WORLDS:
        options = {"sensor": given.sensor, "seed": given.seed, "jobs": given.jobs}
        ends = identify(given.folder, num_objects=given.objects, world=world, **options).namings
        stops = [one for one in ends if one.is_certain]
        named = [one for one in stops if one.named != UNLISTED]
        right = sum(one.is_right for one in named)
        low, high = wilson_interval(len(named) - right, given.objects)
        touches = sum(len(one.poses) for one in ends) / given.objects
        numbers = right, len(named) - right, f"{low:.2f}–{high:.2f}", len(stops) - len(named), len(ends) - len(stops)
        rows.append((world or "as described", *numbers, touches))
    columns = ["world", ("right", "d"), ("wrong", "d"), "wrong, 95 %", (NONE_OF_THESE, "d"), ("open", "d")]
    print(Table(f"{given.sensor}: {given.objects} objects a row", [*columns, ("touches", ".2f")], rows))


if __name__ == "__main__":
    main()
