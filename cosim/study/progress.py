"""How far a study is: shown in the terminal, and kept in the store for `cosim study --status`."""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from cosim.errors import InputError, span
from cosim.study.execute import Count
from cosim.study.store import Store, StoreError

EVERY = 1.0
"""Seconds between two notes in the store."""
LINES = 5.0
"""Seconds between two lines, where there is no terminal."""
SILENT = 30.0
"""Seconds without a note after which a study counts as not running: nothing ended in them, or it
was cut off."""


@dataclass(frozen=True)
class Note:
    """How far a study was when its driver last said so."""

    name: str
    total: int
    done: int
    failed: int
    handed_out: int
    solved: int
    seconds: float
    """Since this driver began."""
    written: float
    """s since 1970."""
    host: str
    pid: int
    ended: bool

    @property
    def rate(self) -> float | None:
        """Runs solved a second, by this driver."""
        return self.solved / self.seconds if self.solved and self.seconds > 0 else None

    @property
    def remaining(self) -> float | None:
        """The time that is left (s) at that rate."""
        return None if self.rate is None else (self.total - self.done) / self.rate


@contextmanager
def progress(name: str, store: Store) -> Iterator[Callable[[Count], None]]:
    """A function to call at the end of every run, which shows and stores how far the study is."""
    begun, shown_at, last = time.monotonic(), [0.0], [Count(0)]

    def note(count: Count, ended: bool) -> Note:
        content = Note(
            *(name, count.total, count.done, count.failed, count.handed_out, count.solved),
            *(time.monotonic() - begun, time.time(), socket.gethostname(), os.getpid(), ended),
        )
        path = store.root / "studies" / f"{name}.json"
        store.write(path, json.dumps(vars(content)).encode())
        return content

    with _progress_display(name) as show:

        def tell(count: Count) -> None:
            last[0] = count
            now = time.monotonic()
            if now - shown_at[0] >= EVERY or count.done == count.total:
                shown_at[0] = now
                show(note(count, ended=False))

        try:
            yield tell
        finally:
            with suppress(StoreError):  # a full disk has been told of already
                note(last[0], ended=True)


@contextmanager
def _progress_display(name: str) -> Iterator[Callable[[Note], None]]:
    """A bar on a terminal, else a line now and then."""
    if not sys.stderr.isatty():
        yield _lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TextColumn("{task.fields[rest]}"), console=Console(stderr=True)) as bar:
        task = bar.add_task(name, rest="")
        yield lambda note: bar.update(task, total=note.total, completed=note.done, rest=_rest(note))


def _lines() -> Callable[[Note], None]:
    shown_at = [-LINES]

    def show(note: Note) -> None:
        now = time.monotonic()
        if now - shown_at[0] >= LINES or note.done == note.total:
            shown_at[0] = now
            typer.echo(f"{note.name}: {note.done}/{note.total}, {_rest(note)}", err=True)

    return show


def _rest(note: Note) -> str:
    rate = "" if note.rate is None else f", {note.rate:.3g} runs/s"
    left = "" if note.remaining is None or not note.remaining else f", {span(note.remaining)} left"
    return f"{note.failed} failed{rate}{left}"


def notes(root: Path) -> list[Note]:
    """The notes of every study of a store, by name. Raises InputError where there is no store."""
    if not (root / "format.json").is_file():
        raise InputError(f"{root}: is no store of studies; `cosim study` names the one it uses")
    return [_note(path) for path in sorted((root / "studies").glob("*.json"))]


def _note(path: Path) -> Note:
    try:
        values: Any = json.loads(path.read_bytes())
        return Note(**values)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); delete it") from error


def state_text(note: Note, now: float) -> str:
    """What the study is doing, as far as its last note says."""
    if note.ended:
        return "ended" if note.done == note.total else "stopped"
    if note.host == socket.gethostname() and not _is_alive(note.pid):
        return "cut off"
    silent = now - note.written
    if silent > SILENT:
        return f"no word for {span(silent)}: cut off, or in a long run"
    return f"running on {note.host}"


def _is_alive(pid: int) -> bool:
    import psutil

    return bool(psutil.pid_exists(pid))
