"""Run independent tasks on several processes or machines, with a progress bar; yield results as tasks finish."""

from __future__ import annotations

import os
import re
import socket
import tempfile
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pickle import PicklingError
from typing import Any, TypeVar

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from activetouch.errors import MeshWarning
from belief.errors import ActiveTouchError, CannotWrite
from belief.files import is_of_writing
from experiments.command_line.console import plain_console
from experiments.command_line.workers import block_interrupt, end_with_parent

T = TypeVar("T")

_SECONDS_TO_CONNECT = 30


class NoCluster(ActiveTouchError, ConnectionError):
    """No Dask scheduler or worker can be reached, or Dask is not installed."""


def default_jobs() -> int:
    """Number of processors that this process may use."""
    import joblib

    return joblib.cpu_count()


def progress_bar() -> Progress:
    """The progress bar of all commands: description, progress, elapsed and remaining time."""
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
    tasks: Sequence[Callable[[], T]], jobs: int | None, description: str, scheduler: str | None = None
) -> Iterator[T]:
    """Yield the result of every task in order of completion; see :func:`run_lazily`."""
    return run_lazily(tasks, len(tasks), jobs, description, scheduler)


def run_lazily(
    tasks: Iterable[Callable[[], T]], total: int, jobs: int | None, description: str, scheduler: str | None = None
) -> Iterator[T]:
    """Yield the result of every task in order of completion; take each task from the iterable shortly before it runs.

    With one job, the tasks run in this process. Linear algebra uses one thread, in this process too: the last bit of a
    sum depends on the number of threads. Workers end with this process and on an interrupt.

    Args:
        tasks: at most ``total`` tasks.
        total: number at which the progress bar is full.
        jobs: number of processes on this machine; as many as processors if None.
        description: text of the progress bar.
        scheduler: address of a Dask scheduler whose workers run the tasks instead, such as tcp://10.0.0.1:8786.

    Raises:
        NoCluster: The scheduler does not answer or has no workers, or the extra ``dask`` is not installed.
    """
    from threadpoolctl import threadpool_limits

    jobs = default_jobs() if jobs is None else jobs
    alone = jobs == 1 and scheduler is None
    with threadpool_limits(1) if alone else _backend(scheduler), progress_bar() as progress:
        bar = progress.add_task(description, total=total)
        with closing((task() for task in tasks) if alone else _in_parallel(tasks, jobs)) as results:
            for result in results:
                progress.advance(bar)
                yield result
        progress.update(bar, completed=total)


def _in_parallel(tasks: Iterable[Callable[[], T]], jobs: int) -> Generator[T, None, None]:
    """The results of :func:`run_lazily`, from the workers of the backend."""
    import joblib

    parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch="2*n_jobs")
    with block_interrupt():
        results = parallel(joblib.delayed(task)() for task in tasks)
    try:
        yield from results
    except PicklingError as error:
        if (cause := _of_full_disk(error)) is None:
            raise
        folder = os.environ.get("JOBLIB_TEMP_FOLDER") or f"/dev/shm or {tempfile.gettempdir()}"
        raise CannotWrite(
            f"what the processes share does not fit into the temporary folder, {folder}: {cause.strerror}. Make room "
            "there, set JOBLIB_TEMP_FOLDER to a folder with more room, or use --jobs 1. Finished results are kept"
        ) from error
    finally:
        with warnings.catch_warnings():  # of unfinished tasks, when the caller stops early
            warnings.simplefilter("ignore", UserWarning)
            results.close()


def _of_full_disk(error: PicklingError) -> OSError | None:
    """The error of writing that kept a task from being sent, of which joblib gives only the text; None if none did."""
    found = re.search(r"^OSError: \[Errno (\d+)\]", str(error.__cause__), re.MULTILINE)
    cause = None if found is None else OSError(int(found[1]), os.strerror(int(found[1])))
    return cause if cause is not None and is_of_writing(cause) else None


@contextmanager
def _backend(scheduler: str | None) -> Iterator[Any]:
    import joblib

    if scheduler is None:
        ending = {"initializer": _begin_worker, "initargs": (os.getpid(),)}
        with joblib.parallel_config("loky", inner_max_num_threads=1, **ending) as config:
            yield config
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise NoCluster("a Dask cluster needs the extra dask: pip install 'activetouch[dask]'") from error
    try:
        _wait_for(scheduler)
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


def _begin_worker(parent: int) -> None:
    """Make a worker end with its parent, and not repeat what that has said about mesh files."""
    end_with_parent(parent)
    warnings.simplefilter("ignore", MeshWarning)


def _wait_for(scheduler: str) -> None:
    """Wait until something answers at the address of a scheduler.

    A client of Dask that finds none is left half made. If it is collected while another one starts, both wait for ever.

    Raises:
        OSError: nothing answers in time.
        ValueError: it is no address.
    """
    from distributed.comm.addressing import get_address_host_port

    place, end = get_address_host_port(scheduler), time.monotonic() + _SECONDS_TO_CONNECT
    while True:
        try:
            socket.create_connection(place, timeout=_SECONDS_TO_CONNECT).close()
            return
        except OSError:
            if time.monotonic() >= end:
                raise
            time.sleep(0.1)
