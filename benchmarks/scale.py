"""Measure the overhead of other processes: milliseconds per batch and per episode.

    python benchmarks/scale.py

A task only returns as many bytes as a batch of 25 searches has.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial

import tyro

from experiments.parallel import run_tasks
from experiments.search.play import EPISODES_PER_BATCH

_LINE = "x" * 4000  # a search of seven touches of four shapes, as JSON


def a_batch(number: int) -> tuple[int, list[str]]:
    """A number and the lines of a batch."""
    return number, [_LINE] * EPISODES_PER_BATCH


@dataclass(frozen=True)
class Scale:
    """Measure the overhead of an episode."""

    tasks: int = 200
    """Batches to send."""

    def run(self) -> None:
        """Measure and print."""
        for name, jobs in (("this process", 1), ("2 processes", 2)):
            list(run_tasks([partial(a_batch, 0)] * 4, jobs, "starting"))
            started = time.perf_counter()
            list(run_tasks([partial(a_batch, n) for n in range(self.tasks)], jobs, name))
            each = 1e3 * (time.perf_counter() - started) / self.tasks
            episode = each / EPISODES_PER_BATCH
            print(f"{name:<20} {each:7.2f} ms a batch of {EPISODES_PER_BATCH}, {episode:6.3f} ms an episode")


if __name__ == "__main__":
    tyro.cli(Scale).run()
