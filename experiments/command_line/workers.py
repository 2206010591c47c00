"""Worker processes that end when the process ends that they work for."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.context import BaseContext
from types import FrameType
from typing import TypeVar

from joblib.externals.loky.backend import resource_tracker as loky_resource_tracker

T = TypeVar("T")

_EVERY = 0.5  # seconds


def end_with_parent(parent: int | None = None) -> None:
    """Make this process end soon after another: the initializer of a pool of workers.

    A worker is left behind where its parent is killed, since it waits for its next task on a pipe that its fellows
    hold open. So a thread looks for the parent. Linux's signal for the death of a parent will not do: it is sent when
    the thread ends that started the worker. Ctrl-C is left to the parent, which ends its workers.

    Args:
        parent: number of the process that starts the workers; not needed where multiprocessing itself starts them.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_watch, args=(parent,), name="end-with-parent", daemon=True).start()


def _watch(parent: int | None) -> None:
    if parent is None:
        origin = multiprocessing.parent_process()
        assert origin is not None, "it is no process of multiprocessing"
        origin.join()
    while os.getppid() == parent:
        time.sleep(_EVERY)
    os._exit(1)


def end_workers() -> None:
    """Kill the processes that this one started to share its work."""
    for child in multiprocessing.active_children():
        if child.pid is not None:
            with suppress(ProcessLookupError):  # loky's processes have no kill()
                os.kill(child.pid, getattr(signal, "SIGKILL", signal.SIGTERM))


@contextmanager
def born_deaf() -> Iterator[None]:
    """Start the processes of a block so that they do not hear Ctrl-C; this one hears it when the block ends.

    A new process inherits which signals its starter blocks. The trackers of shared resources are started before,
    because starting one ends the blocking.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler) or os.name != "posix":
        yield
        return
    resource_tracker.ensure_running()
    loky_resource_tracker.ensure_running()
    heard: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: heard.append((number, frame)))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
        if heard:
            handler(*heard[0])


def in_own_process(context: BaseContext, function: Callable[..., T], *arguments: object) -> T:
    """What a function returns in a new process, which ends with this one or with an interrupt."""
    with ProcessPoolExecutor(1, context, initializer=end_with_parent) as pool:
        try:
            with born_deaf():
                result = pool.submit(function, *arguments)
            return result.result()
        except KeyboardInterrupt:
            end_workers()
            raise
