"""What asks the program to end: Ctrl-C, a closed terminal (SIGHUP), and SIGTERM, as a queue of jobs
or a shutdown sends it."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import time
from _thread import interrupt_main
from contextlib import suppress
from threading import Timer, main_thread
from types import FrameType
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""Those that this system knows: SIGHUP is not on Windows, SIGBREAK (Ctrl-Break, a closed console)
is there alone."""
ASKING = tuple(getattr(signal, name) for name in NAMES if hasattr(signal, name))
STOPPED = 128
"""Exit codes of a program that a signal ended, beside the signal's number."""
AGAIN = 2.0
"""Seconds in which requests count as one: shell and kernel both send SIGHUP."""
LATER = 0.02
"""Seconds after which a request that was lost is made again."""


class _Request:
    """The last signal that asked this process to end, and when; whether its end is seen to, and
    with which exit code."""

    def __init__(self) -> None:
        self.signal, self.at, self.is_met = 0, -AGAIN, False
        self.code: Any = None


_REQUEST = _Request()


def exit_on_request() -> None:
    """Let the program end at once and in one line where it is asked to: while it loads, there is
    nothing to clear away.  A request that its starter has it ignore (nohup) stays ignored."""
    _handle(_exit)
    if not _REQUEST.is_met:
        _REQUEST.is_met = True
        atexit.register(_end)  # the first of them, and so called last


def interrupt_on_request() -> None:
    """Let each request raise KeyboardInterrupt in the main thread: all end a command alike."""
    exit_on_request()
    _handle(_interrupt)
    sys.unraisablehook = _unraisable


def ignore_requests() -> None:
    """Let nothing cut short what the program clears away as it ends."""
    _handle(signal.SIG_IGN)


def is_asked() -> bool:
    """Whether anything asked the program to end."""
    return _REQUEST.signal != 0


def exit_code(code: Any = None) -> Any:
    """The exit code of a command that would end with `code`: 130 where the user ended it, 143
    where SIGTERM did and 129 where SIGHUP did; 0 of one that Ctrl-C is to end (`cosim ui`)."""
    if is_asked() and not (_REQUEST.signal == signal.SIGINT and code == 0):
        code = STOPPED + _REQUEST.signal
    _REQUEST.code = code
    return code


def _end() -> None:
    """Leave with the exit code, where anything asked for it: Python would end by SIGINT where the
    KeyboardInterrupt came from code that was made as a text, and libraries whose import was cut off
    crash as they are unloaded.  A request that comes later than this is too late."""
    ignore_requests()
    if is_asked():
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):  # a pipe that nobody reads any more
                stream.flush()
        os._exit(_REQUEST.code or 0)


def _handle(handler: Any) -> None:
    for number in ASKING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


def _exit(number: int, _: FrameType | None) -> None:
    os.write(2, b"cosim: stopped before it began\n")
    os._exit(STOPPED + number)


def _interrupt(number: int, _: FrameType | None) -> None:
    now, asked = time.monotonic(), _REQUEST
    is_repeated = number != signal.SIGINT and asked.signal and now - asked.at < AGAIN
    asked.signal, asked.at = number, now
    if not is_repeated:
        raise KeyboardInterrupt


def _unraisable(lost: sys.UnraisableHookArgs) -> None:
    """Ask again, a little later, where a request met a function whose errors Python drops."""
    if lost.exc_type is KeyboardInterrupt and _REQUEST.signal:
        _REQUEST.at = -AGAIN
        Timer(LATER, _ask_again).start()
    else:
        sys.__unraisablehook__(lost)


def _ask_again() -> None:
    if sys.platform == "win32":
        interrupt_main(_REQUEST.signal)
    else:  # wakes it
        signal.pthread_kill(main_thread().ident or 0, _REQUEST.signal)
