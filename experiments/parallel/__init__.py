"""Run independent tasks on several processes, with a progress bar or lines; yield results as tasks finish."""

from __future__ import annotations

import html
import os
import pickle
import re
import signal
import tempfile
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache, partial
from multiprocessing import resource_tracker
from pathlib import Path
from pickle import PicklingError
from types import FrameType
from typing import Any, Generic, Literal, TypeAlias, TypeVar

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.progress import Task as Row
from rich.text import Text

from activetouch.errors import MeshWarning
from belief.errors import BrokenContract, CannotWrite
from belief.references import ForeignCode, look_in
from experiments.command_line.console import plain_console

T = TypeVar("T")
Task: TypeAlias = Callable[[], T]
"""A function without arguments; more than one process needs those that can be pickled."""
Engine: TypeAlias = Callable[[Sequence["partial[Any]"], str], Generator[Any, None, None]]
"""Yields the results of tasks in order of completion; it has a description of them."""
ENGINE: ContextVar[Engine | None] = ContextVar("ENGINE", default=None)
"""What runs tasks in place of the processes of this machine (:mod:`experiments.parallel.cluster`)."""


def default_jobs() -> int:
    """Number of processors that this process may use."""
    import joblib

    return joblib.cpu_count()


SECONDS_PER_LINE = 60.0
"""Time between two lines about the progress where there is no terminal."""
SECONDS_PER_PICTURE = 0.3
"""Time between two pictures of a bar in a notebook."""


def time_left(row: Row) -> str:
    """The time that is left at the mean speed of this process so far, as h:mm:ss; "-:--:--" before anything is done.

    rich's own estimate looks back half a minute, in which a task of ours may not end.
    """
    done = row.completed - row.fields["begun"]
    if row.total is None or not row.elapsed or done <= 0:
        return "-:--:--"
    return _clock(row.elapsed / done * (row.total - row.completed))


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(max(seconds, 0.0)), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


class _TimeLeft(ProgressColumn):
    """Remaining time."""

    def render(self, task: Row) -> Text:
        return Text(time_left(task), style="progress.remaining")


class _Progress(Progress):
    """A progress bar, in a notebook without widgets; elsewhere a line about every minute says how far its tasks are."""

    _cell: Any = None  # what a notebook shows below the cell
    _shown = 0.0

    def add_task(
        self,
        description: str,
        start: bool = True,
        total: float | None = 100.0,
        completed: int = 0,
        visible: bool = True,
        **fields: Any,
    ) -> TaskID:
        """Add a task; what is completed already does not count in the speed."""
        return super().add_task(description, start, total, completed, visible, begun=completed, **fields)

    def start(self) -> None:
        """Show the bar, or begin to print lines."""
        self._ended = threading.Event()
        if self.console.is_jupyter:
            return
        super().start()
        if not self.console.is_terminal:
            threading.Thread(target=self._print_lines, name="progress", daemon=True).start()

    def stop(self) -> None:
        """Show the bar a last time."""
        self._ended.set()
        if self.console.is_jupyter:
            self._show()
        else:
            super().stop()

    def update(self, task_id: TaskID, **changes: Any) -> None:
        """Change a task."""
        super().update(task_id, **changes)
        self._show_sometimes()

    def advance(self, task_id: TaskID, advance: float = 1) -> None:
        """Advance a task."""
        super().advance(task_id, advance)
        self._show_sometimes()

    def _show_sometimes(self) -> None:
        if self.console.is_jupyter and time.monotonic() - self._shown > SECONDS_PER_PICTURE:
            self._show()

    def _show(self) -> None:
        """Show the bar below the cell of a notebook."""
        from IPython.display import HTML, display

        bars = "".join(
            f"<div>{html.escape(row.description)} <progress value='{row.completed}' max='{row.total or 1}'></progress> "
            f"{int(row.completed)}/{int(row.total or 0)}, {_clock(row.elapsed or 0.0)}, left {time_left(row)}</div>"
            for row in self.tasks
        )
        self._shown = time.monotonic()
        if self._cell is None:
            self._cell = display(HTML(bars), display_id=True)
        else:
            self._cell.update(HTML(bars))

    def _print_lines(self) -> None:
        while not self._ended.wait(SECONDS_PER_LINE):
            for row in self.tasks:
                if row.total and row.completed < row.total:
                    words = (
                        f"{int(row.completed)}/{int(row.total)}, {_clock(row.elapsed or 0.0)}, left {time_left(row)}"
                    )
                    with suppress(OSError, ValueError):  # the output was closed; whoever prints a result says so
                        self.console.print(f"{row.description}: {words}", soft_wrap=True)


def progress_bar() -> Progress:
    """The progress of all commands: description, progress, elapsed and remaining time; a line a minute in a file."""
    return _Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        _TimeLeft(),
        console=plain_console(),
    )


@contextmanager
def removed_after(path: str, kind: Literal["file", "folder"]) -> Iterator[None]:
    """Have joblib's tracker of resources remove a temporary file or folder if this process is killed in the block."""
    from joblib.externals.loky.backend import resource_tracker as loky_resource_tracker

    loky_resource_tracker.register(path, kind)
    try:
        yield
    finally:
        loky_resource_tracker.unregister(path, kind)


class Shared(Generic[T]):
    """A large value of many tasks: each worker process reads it once, from a temporary file.

    Objects of classes that a script or a notebook defines are sent with their code.
    """

    def __init__(self, value: T) -> None:
        self.value = value
        self._file: str | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Write the file when the first task is sent; it is removed with this object."""
        if self._file is None:
            from joblib.externals.loky.backend.reduction import dump  # that of cloudpickle

            handle, self._file = tempfile.mkstemp(".pickle", "activetouch-", os.environ.get("JOBLIB_TEMP_FOLDER"))
            kept = ExitStack()
            kept.callback(Path(self._file).unlink, missing_ok=True)
            kept.enter_context(removed_after(self._file, "file"))
            weakref.finalize(self, kept.close)
            with os.fdopen(handle, "wb") as file:
                dump(self.value, file)
        return _received, (self._file, os.getcwd())


@lru_cache(maxsize=1)
def _received(file: str, folder: str) -> Shared[Any]:
    look_in(folder)  # for the modules of a user
    return Shared(pickle.loads(Path(file).read_bytes()))


def run_tasks(
    tasks: Sequence[Task[T]],
    jobs: int | None,
    description: str,
    costs: Sequence[float] | None = None,
    fills_cache: bool = False,
) -> Iterator[T]:
    """Yield the result of every task in order of completion; without a number of jobs, on all processors.

    One job runs in this process. Linear algebra uses one thread in any case: the last bit of a sum depends on the
    number of threads. Workers end with this process and on an interrupt. The progress bar advances by ``costs``, in any
    unit. On a cluster, ``jobs`` counts for tasks that fill the cache of this machine alone.
    """
    from threadpoolctl import threadpool_limits

    jobs = default_jobs() if jobs is None else jobs
    if not tasks:
        return
    shares = [len(tasks) * cost / sum(costs) for cost in costs] if costs else [1.0] * len(tasks)
    flat, done = [partial(task) for task in tasks], 0.0  # a partial of a partial is one
    parts = [
        partial(_with_share, share, one.func, *one.args, **one.keywords)
        for share, one in zip(shares, flat, strict=True)
    ]
    engine = None if fills_cache else ENGINE.get()
    with threadpool_limits(1), progress_bar() as progress:
        bar = progress.add_task(description, total=len(tasks))
        here = (called(part) for part in parts) if jobs == 1 else _in_parallel(parts, jobs)
        with closing(here if engine is None else engine(parts, description)) as results:
            for result, share in results:
                done += share
                progress.update(bar, completed=round(done, 6))  # of which the whole part is shown
                yield result


def _with_share(share: float, function: Callable[..., T], *arguments: Any, **named: Any) -> tuple[T, float]:
    return function(*arguments, **named), share


def _in_parallel(tasks: Sequence[Task[T]], jobs: int) -> Generator[T, None, None]:
    """The results of :func:`run_tasks`, from worker processes."""
    import joblib

    ending = {"initializer": _begin_worker, "initargs": (os.getpid(),)}
    # A worker that was idle for long ends, and another one begins: nothing that a user has to know.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    with joblib.parallel_config("loky", inner_max_num_threads=1, **ending):
        parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch="2*n_jobs")
    with block_interrupt():
        results = parallel(joblib.delayed(called)(task) for task in tasks)
    try:
        yield from results
    except PicklingError as error:
        if (cause := _of_full_disk(error)) is None:
            said = str(error.__cause__).rstrip('"\n ').rpartition("\n")[2]
            raise BrokenContract(f"what the processes share cannot be copied to them: {said}. Use --jobs 1") from error
        folder = os.environ.get("JOBLIB_TEMP_FOLDER") or f"/dev/shm or {tempfile.gettempdir()}"
        raise CannotWrite(
            f"what the processes share does not fit into the temporary folder, {folder}: {cause.strerror}. Make room "
            "there, set JOBLIB_TEMP_FOLDER to a folder with more room, or use --jobs 1. Finished results are kept"
        ) from error
    finally:
        with warnings.catch_warnings():  # of unfinished tasks, when the caller stops early
            warnings.simplefilter("ignore", UserWarning)
            results.close()


def called(task: Task[T]) -> T:
    """The result of a task, which may run code of a user."""
    with ForeignCode():
        return task()


def _of_full_disk(error: PicklingError) -> OSError | None:
    """The disk error that kept a task from being sent, of which joblib gives only the text; None if there was none."""
    found = re.search(r"^OSError: \[Errno (\d+)\]", str(error.__cause__), re.MULTILINE)
    return None if found is None else OSError(int(found[1]), os.strerror(int(found[1])))


def _begin_worker(parent: int) -> None:
    """Make a worker ignore Ctrl-C, end with its parent, and not repeat the parent's warnings about files.

    A thread watches the parent. Without it, workers of a killed parent wait forever for a task, on a pipe that the
    other workers keep open. ``PR_SET_PDEATHSIG`` is unsuitable: Linux sends it when the starting *thread* ends.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its workers
    threading.Thread(target=watch, name="end-with-parent", daemon=True).start()
    say_no_more()


def say_no_more() -> None:
    """Ignore warnings about files that the process which gives the tasks prints."""
    from planners.ppo import UnknownNormalization

    for said in (MeshWarning, UnknownNormalization):
        warnings.simplefilter("ignore", said)


@contextmanager
def block_interrupt() -> Iterator[None]:
    """Block Ctrl-C in all processes that are started within the block; this process handles it after the block.

    New processes inherit the blocked signals. The resource trackers are started first, because starting one unblocks
    the signals. SIGTERM waits for the end of the block as well, where something handles it: what is half started could
    not be closed.
    """
    handlers = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    deferred = {each: usual for each, usual in handlers.items() if callable(usual)}
    if threading.current_thread() is not threading.main_thread() or signal.SIGINT not in deferred or os.name != "posix":
        yield
        return
    from joblib.externals.loky.backend import resource_tracker as loky_resource_tracker

    resource_tracker.ensure_running()
    loky_resource_tracker.ensure_running()
    heard: list[tuple[int, FrameType | None]] = []
    for each in deferred:
        signal.signal(each, lambda number, frame: heard.append((number, frame)))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for each, usual in deferred.items():
            signal.signal(each, usual)
        if heard:
            deferred[signal.Signals(heard[0][0])](*heard[0])
