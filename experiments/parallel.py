"""Run independent tasks on several processes or machines, with a progress bar, and hand back results as they finish."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import joblib
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from belief.errors import ActiveTouchError
from experiments.command_line.console import plain_console
from experiments.command_line.workers import born_deaf, end_with_parent

T = TypeVar("T")

_SECONDS_TO_CONNECT = 30


class NoCluster(ActiveTouchError, ConnectionError):
    """There is no Dask scheduler to send tasks to, or nothing to reach one with."""


def default_jobs() -> int:
    """Processors this process may use."""
    return joblib.cpu_count()


def progress_bar() -> Progress:
    """The progress bar every command shows: what, how far, how long still."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=plain_console(),
    )


def run_tasks(
    tasks: Sequence[Callable[[], T]], jobs: int, description: str, scheduler: str | None = None
) -> Iterator[T]:
    """Yield the result of every task, in order of completion; see :func:`run_lazily`."""
    return run_lazily(tasks, len(tasks), jobs, description, scheduler)


def run_lazily(
    tasks: Iterable[Callable[[], T]], total: int, jobs: int, description: str, scheduler: str | None = None
) -> Iterator[T]:
    """Yield the result of every task, in order of completion; tasks are asked for shortly before they run.

    Several workers use one thread each for linear algebra, because together they already use all cores; one job runs
    in this process. An interrupt stops them, and they end when this process does, whatever ends it. Whatever was
    yielded before is the caller's to keep.

    Args:
        tasks: at most ``total`` of them.
        total: what the progress bar counts up to.
        jobs: processes of this machine.
        description: what the progress bar says.
        scheduler: address of a Dask scheduler whose workers run the tasks instead, such as tcp://10.0.0.1:8786.

    Raises:
        NoCluster: the scheduler does not answer or has no workers, or the extra ``dask`` is not installed.
    """
    with _backend(scheduler), progress_bar() as progress:
        parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch="2*n_jobs")
        bar = progress.add_task(description, total=total)
        results: Any = (None for _ in range(0))
        try:
            with born_deaf():
                results = parallel(joblib.delayed(task)() for task in tasks)
            for result in results:
                progress.advance(bar)
                yield result
        finally:
            with warnings.catch_warnings():  # that tasks are left undone where the caller stops early, as it knows
                warnings.simplefilter("ignore", UserWarning)
                results.close()
        progress.update(bar, completed=total)


@contextmanager
def _backend(scheduler: str | None) -> Iterator[Any]:
    if scheduler is None:
        ending = {"initializer": end_with_parent, "initargs": (os.getpid(),)}
        with joblib.parallel_config("loky", inner_max_num_threads=1, **ending) as config:
            yield config
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise NoCluster("a Dask cluster needs the extra dask: pip install 'activetouch[dask]'") from error
    try:
        client = Client(scheduler, timeout=_SECONDS_TO_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise NoCluster(f"no Dask scheduler answers at {scheduler}: {error}. Start one with: dask scheduler") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_SECONDS_TO_CONNECT)
        except TimeoutError as error:
            raise NoCluster(f"{scheduler} has no workers. Start some with: dask worker {scheduler}") from error
        with joblib.parallel_config("dask", client=client) as config:
            yield config
