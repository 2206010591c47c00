"""One comparison over several seeds: the searches of all of them in one table and one verdict.

    python -m benchmarks.seeds 1 2 -- --scene coarse --deciders information_gain random_poses --episodes 125

The arguments after -- are those of `activetouch compare`. Each seed has a folder of its own, so that an interrupted run
continues; the folder of --out gets the tables of all.
"""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
import tyro

from experiments.search.compare import Compare
from experiments.search.comparison import Comparison
from experiments.search.play import Seconds
from experiments.search.verdict import comparison_tables


def pooled(found: Sequence[Comparison], seed: int = 0) -> Comparison:
    """One comparison of all searches of several, which have the same deciders, targets and problem but other seeds."""
    first = found[0]
    episodes = {key: list(chain.from_iterable(one.episodes[key] for one in found)) for key in first.episodes}
    seconds = {key: sum((one.cells[key].seconds for one in found), Seconds()) for key in first.episodes}
    return Comparison.from_episodes(first.problem, episodes, seconds, first.reference, np.random.default_rng(seed))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", nargs="+", type=int)
    here = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    seeds = parser.parse_args(sys.argv[1:here]).seeds
    asked = tyro.cli(Compare, args=sys.argv[here + 1 :])
    runs = [replace(asked, seed=seed, out=asked.folder.with_name(f"{asked.folder.name}-seed{seed}")) for seed in seeds]
    comparison = pooled([run.play() for run in runs])
    for table in comparison_tables(comparison):
        table.write_csv(asked.folder / "tables" / f"{table.name}.csv")
    print(comparison, end="\n\n")
    for sentence in [*comparison.verdict(), f"Seeds: {', '.join(map(str, seeds))}."]:
        print(textwrap.fill(sentence, 78))


if __name__ == "__main__":
    main()
