"""Worker processes that end together with the process that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from types import FrameType

_EVERY = 0.5  # seconds


def end_with_parent(parent: int | None = None) -> None:
    """Make this process end soon after its parent; used as the initializer of a pool of workers.

    A thread watches the parent, whose process id is needed unless :mod:`multiprocessing` starts the workers. Without
    it, workers of a killed parent wait forever. ``PR_SET_PDEATHSIG`` is unsuitable: Linux sends it when the starting
    *thread* ends. The worker ignores Ctrl-C; the parent ends its workers.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_watch, args=(parent,), name="end-with-parent", daemon=True).start()


def _watch(parent: int | None) -> None:
    if parent is None:
        origin = multiprocessing.parent_process()
        assert origin is not None, "not a process of multiprocessing"
        origin.join()
    while os.getppid() == parent:
        time.sleep(_EVERY)
    os._exit(1)


def end_workers() -> None:
    """Kill all worker processes of this process."""
    for child in multiprocessing.active_children():
        if child.pid is not None:
            with suppress(ProcessLookupError):  # loky's processes have no kill()
                os.kill(child.pid, getattr(signal, "SIGKILL", signal.SIGTERM))


@contextmanager
def block_interrupt() -> Iterator[None]:
    """Block Ctrl-C in all processes that are started within the block; this process handles it after the block.

    New processes inherit the blocked signals. The resource trackers are started first, because starting one unblocks
    the signals.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler) or os.name != "posix":
        yield
        return
    from joblib.externals.loky.backend import resource_tracker as loky_resource_tracker

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
