"""Measure the overhead of other processes or machines: milliseconds per shard and per episode.

    python benchmarks/scale.py                                        this process, two processes, a Dask cluster of two
    python benchmarks/scale.py --scheduler tcp://10.0.0.1:8786        your cluster

A task only returns as many bytes as a shard of 25 searches has.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial

import tyro

from experiments.parallel import run_tasks
from experiments.search.run_folder import EPISODES_PER_SHARD

_LINE = "x" * 4000  # a search of seven touches of four shapes, as JSON


def a_shard(number: int) -> tuple[int, list[str]]:
    """A number and the lines of a shard."""
    return number, [_LINE] * EPISODES_PER_SHARD


@dataclass(frozen=True)
class Scale:
    """Measure the overhead of an episode."""

    tasks: int = 200
    """Shards to send."""
    scheduler: str | None = None
    """Address of a Dask scheduler; a cluster of two workers on this machine by default."""

    def run(self) -> None:
        """Measure and print."""
        for name, jobs, cluster in (
            ("this process", 1, nullcontext(None)),
            ("2 processes (loky)", 2, nullcontext(None)),
            ("Dask", 1, nullcontext(self.scheduler) if self.scheduler else _local_cluster()),
        ):
            with cluster as scheduler:
                list(run_tasks([partial(a_shard, 0)] * 4, jobs, "starting", scheduler))
                started = time.perf_counter()
                list(run_tasks([partial(a_shard, n) for n in range(self.tasks)], jobs, name, scheduler))
                seconds = time.perf_counter() - started
            each = 1e3 * seconds / self.tasks
            episode = each / EPISODES_PER_SHARD
            print(f"{name:<20} {each:7.2f} ms a shard of {EPISODES_PER_SHARD}, {episode:6.3f} ms an episode")


@contextmanager
def _local_cluster() -> Iterator[str]:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


if __name__ == "__main__":
    tyro.cli(Scale).run()
