"""Handling of Ctrl-C and SIGTERM: a command prints one line, ends its worker processes and keeps finished results.

This module imports only the standard library, because it must be active while all other modules are imported.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

_MESSAGE = "interrupted; what was written is kept. The same command goes on, or starts again if it writes at its end"


class Terminated(KeyboardInterrupt):
    """The process received SIGTERM; handled like Ctrl-C."""


@contextmanager
def loading() -> Iterator[None]:
    """End the process at once on Ctrl-C or SIGTERM, while modules are imported and arguments are parsed.

    An exception is unsuitable here, because C extension modules convert it to other errors.
    """
    with _handled_by(_end_at_once):
        yield


@contextmanager
def running() -> Iterator[None]:
    """On Ctrl-C or SIGTERM, stop the command and its workers, print a message and end the process."""
    code = 0
    with _handled_by(_stop):
        try:
            yield
        except (KeyboardInterrupt, Exception) as error:
            cause: BaseException | None = error  # cleaning up may have failed after the signal
            while cause is not None and not isinstance(cause, KeyboardInterrupt):
                cause = cause.__context__
            if cause is None:
                raise
            code = 128 + (signal.SIGTERM if isinstance(cause, Terminated) else signal.SIGINT)
        if code:  # outside of the except block, so that the progress bar is closed
            _end_workers()
            print(f"\n{_MESSAGE}", file=sys.stderr)
            sys.exit(code)


@contextmanager
def _handled_by(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Set the handler of both signals within a block; one that the parent process made us ignore stays ignored."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for number, usual in before.items():
            if usual is not signal.SIG_IGN:
                signal.signal(number, handler)
        yield
    finally:
        for number, usual in before.items():
            signal.signal(number, usual)


def _end_at_once(number: int, frame: FrameType | None) -> None:
    os.write(2, f"\n{_MESSAGE}\n".encode())
    os._exit(128 + number)


def _stop(number: int, frame: FrameType | None) -> None:
    """Raise an exception as Python does at Ctrl-C; a second SIGTERM ends the process at once.

    Silences errors of threads and warnings, because joblib's thread may be handing out a task as it stops.
    """
    threading.excepthook = lambda error: None
    warnings.simplefilter("ignore")
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    signal.signal(number, _end_at_once)
    raise Terminated


def _end_workers() -> None:
    """Kill all worker processes of this process."""
    import multiprocessing

    for child in multiprocessing.active_children():
        if child.pid is not None:
            with suppress(ProcessLookupError):  # loky's processes have no kill()
                os.kill(child.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
