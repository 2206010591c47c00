"""Run independent tasks on several processes, with a progress bar, and hand back results as they finish."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import joblib
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

T = TypeVar("T")


def default_jobs() -> int:
    """Processors this process may use."""
    return joblib.cpu_count()


def progress_bar() -> Progress:
    """The progress bar every command shows: what, how far, how long still."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )


def _single_threaded(task: Callable[[], T]) -> T:
    """Call with one thread for linear algebra: the processes already use all cores, and sums keep their order."""
    os.environ["OMP_NUM_THREADS"] = "1"
    return task()


def run_tasks(tasks: Sequence[Callable[[], T]], jobs: int, description: str) -> Iterator[T]:
    """Yield the result of every task, in order of completion.

    An interrupt stops the workers; whatever was yielded before is the caller's to keep.
    """
    parallel = joblib.Parallel(n_jobs=jobs, backend="loky", return_as="generator_unordered", pre_dispatch="2*n_jobs")
    with progress_bar() as progress:
        bar = progress.add_task(description, total=len(tasks))
        for result in parallel(joblib.delayed(_single_threaded)(task) for task in tasks):
            progress.advance(bar)
            yield result
