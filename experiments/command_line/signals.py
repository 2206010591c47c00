"""Handling of Ctrl-C and SIGTERM: a command prints one line, ends its worker processes and keeps finished results.

This module imports only the standard library, because it must be active while all other modules are imported.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
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
    with _handlers(_end_at_once, _end_at_once):
        yield


@contextmanager
def running() -> Iterator[None]:
    """On Ctrl-C or SIGTERM, stop the command and its workers, print a message and end the process.

    Raises:
        SystemExit: 130 after Ctrl-C, 143 after SIGTERM.
    """
    code = 0
    with _handlers(_interrupt, _terminate):
        try:
            yield
        except (KeyboardInterrupt, Exception) as error:
            code = _code_of(error)
            if not code:
                raise
        if code:  # outside of the except block, so that the progress bar is closed
            _end_workers()
            print(f"\n{_MESSAGE}", file=sys.stderr)
            sys.exit(code)


def _code_of(error: BaseException) -> int:
    """Exit status of the signal that led to an error, also if cleaning up failed after it; 0 if none did."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return 128 + (signal.SIGTERM if isinstance(cause, Terminated) else signal.SIGINT)
        cause = cause.__context__
    return 0


@contextmanager
def _handlers(interrupt: object, terminate: object) -> Iterator[None]:
    """Set both signal handlers within a block; a signal that the parent process made us ignore stays ignored."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    wanted = {signal.SIGINT: interrupt, signal.SIGTERM: terminate}
    before = {number: signal.getsignal(number) for number in wanted}
    try:
        for number, handler in wanted.items():
            if before[number] is not signal.SIG_IGN:
                signal.signal(number, handler)  # type: ignore[arg-type]
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end_at_once(number: int, frame: FrameType | None) -> None:
    os.write(2, f"\n{_MESSAGE}\n".encode())
    os._exit(128 + number)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise an exception as Python does at Ctrl-C."""
    _silence_libraries()
    raise KeyboardInterrupt


def _terminate(number: int, frame: FrameType | None) -> None:
    """Raise an exception as Ctrl-C does; a second signal ends the process at once."""
    _silence_libraries()
    signal.signal(number, _end_at_once)
    raise Terminated


def _silence_libraries() -> None:
    """Print neither errors of threads nor warnings from now on: joblib's thread may be handing out a task as it stops.

    The process ends soon; one line says why.
    """
    threading.excepthook = lambda error: None
    warnings.simplefilter("ignore")


def _end_workers() -> None:
    """Kill all worker processes of this process."""
    import multiprocessing

    for child in multiprocessing.active_children():
        if child.pid is not None:
            with suppress(ProcessLookupError):  # loky's processes have no kill()
                os.kill(child.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
