"""Run independent tasks on several processes, with a progress bar, and hand back results as they finish."""

from __future__ import annotations

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


def run_tasks(tasks: Sequence[Callable[[], T]], jobs: int, description: str) -> Iterator[T]:
    """Yield the result of every task, in order of completion.

    Several workers use one thread each for linear algebra, because together they already use all cores; one job runs
    in this process. An interrupt stops them; whatever was yielded before is the caller's to keep.
    """
    with joblib.parallel_config("loky", inner_max_num_threads=1), progress_bar() as progress:
        parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch="2*n_jobs")
        bar = progress.add_task(description, total=len(tasks))
        for result in parallel(joblib.delayed(task)() for task in tasks):
            progress.advance(bar)
            yield result
