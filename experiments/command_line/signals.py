"""What Ctrl-C and a signal to end do to a command: one line, no worker left behind, and all that was finished is kept.

Importing this module loads nothing, so that it guards the import of everything else.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_MESSAGE = "interrupted; what was finished is kept, run the same command to go on"
_PATIENCE = 10.0  # seconds until a process that was told to end does so wherever it is


class Terminated(KeyboardInterrupt):
    """The process was told to end, by SIGTERM; handled like Ctrl-C."""


@contextmanager
def loading() -> Iterator[None]:
    """While modules are imported and arguments read, Ctrl-C ends the process at once, as nothing is begun yet.

    An exception would not do: modules written in C turn it into errors of their own.
    """
    with _handlers(_end_at_once, _end_at_once):
        yield


@contextmanager
def running() -> Iterator[None]:
    """While a command works, Ctrl-C and SIGTERM stop it and its workers, say so, and end the process.

    Raises:
        SystemExit: 130 after Ctrl-C, 143 after SIGTERM.
    """
    code = 0
    with _handlers(signal.default_int_handler, _terminate):
        try:
            yield
        except Terminated:
            code = 128 + signal.SIGTERM
        except KeyboardInterrupt:
            code = 128 + signal.SIGINT
        if code:  # the exception is gone by now, and with it the progress bar
            _end_workers()
            print(f"\n{_MESSAGE}", file=sys.stderr)
            sys.exit(code)


@contextmanager
def _handlers(interrupt: object, terminate: object) -> Iterator[None]:
    """Handle both signals in a block; one that whoever started this process has it ignore stays ignored."""
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


def _terminate(number: int, frame: FrameType | None) -> None:
    """Stop as Ctrl-C does, and surely: where the exception is lost in foreign code, a thread ends the process."""
    signal.signal(number, _end_at_once)
    deadline = threading.Timer(_PATIENCE, _give_up)
    deadline.daemon = True
    deadline.start()
    raise Terminated


def _give_up() -> None:
    _end_workers()
    _end_at_once(signal.SIGTERM, None)


def _end_workers() -> None:
    from experiments.command_line.workers import end_workers

    end_workers()
