"""The errors that a person reads, and how a caller follows a long solve."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from math import inf
from typing import Any, Self

Progress = Callable[[str], None]
"""A function that is called with a line of text at each stage of what takes long."""


class ResidualText(str):
    """A line of progress that tells the residual of a state, unloaded or loaded."""

    residual: float
    state: str

    def __new__(cls, text: str, residual: float, state: str = "") -> Self:
        line = super().__new__(cls, text)
        line.residual, line.state = residual, state
        return line

    def __reduce__(self) -> tuple[type[ResidualText], tuple[str, float, str]]:
        return ResidualText, (str(self), self.residual, self.state)


def quiet(text: str) -> None:
    """The progress of a caller who asks for none."""


def named_progress(progress: Progress, state: str) -> Progress:
    """`progress` with the name of a state before each line."""

    def tell(text: str) -> None:
        line = f"{state}: {text}"
        if isinstance(text, ResidualText):
            line = ResidualText(line, text.residual, state)
        progress(line)

    return tell


SILENCE = 10.0
"""s after the last word at which a solver's iteration is told."""


@dataclass
class _Listener:
    """Who hears of a solve, and until when it may go on."""

    tell: Progress = quiet
    patience: float = inf
    """s."""
    last: str = ""
    """What was told last."""
    begun: float = inf
    """s, by the clock."""
    spoken: float = inf
    """s, when something was told last."""

    def say(self, text: str) -> None:
        self.last, self.spoken = text, time.monotonic()
        self.tell(text)

    def pulse(self, form: str, *values: object) -> None:
        now = time.monotonic()
        taken = now - self.begun
        if taken <= self.patience and now - self.spoken <= SILENCE:
            return
        reached = "; ".join(filter(None, (self.last, form.format(*values))))
        if taken > self.patience:
            raise PatienceError(f"solve.patience was over after {taken:.3g} s, at: {reached}")
        self.spoken = now
        self.tell(reached)


_LISTENER: ContextVar[_Listener] = ContextVar("listener")
_NOBODY = _Listener()


@contextmanager
def relay_progress(progress: Progress, patience: float = inf) -> Iterator[Progress]:
    """Let `progress` hear what solvers below say (`say`, `pulse`), in this thread, for `patience`
    s; yields what takes its place within.

    >>> with relay_progress(print) as tell:
    ...     tell("round 1")
    ...     pulse("iteration {}", 7)
    round 1

    A `pulse` later than that raises PatienceError."""
    now = time.monotonic()
    listener = _Listener(progress, patience, "", now, now)
    token = _LISTENER.set(listener)
    try:
        yield listener.say
    finally:
        _LISTENER.reset(token)


def say(text: str) -> None:
    """Tell whoever listens of what goes on where no progress is handed down, behind the port."""
    _LISTENER.get(_NOBODY).say(text)


def pulse(form: str, *values: object) -> None:
    """Let whoever listens end a solve, or hear of it where nothing was said for SILENCE s: called
    in each iteration, with the words for it (`str.format`), which are made where they are needed.
    Raises PatienceError."""
    _LISTENER.get(_NOBODY).pulse(form, *values)


def span(seconds: float) -> str:
    """The words for a time in the terminal.

    >>> span(45), span(600)
    ('45 s', '10 min')
    """
    for unit, size in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.0f} s"


SWAP = 0.5
"""Two neighbouring letters in the other order, against one letter that is wrong."""


def nearest_names(name: str, known: Iterable[str], most: int = 1, share: float = 0.5) -> list[str]:
    """The known names that a mistyped one may mean, the nearest first: those that so many letters
    left out, added, put for another or swapped with their neighbour turn into it, at most the given
    share of its letters.  A name of which it is the beginning counts as near.  Large and small
    letters are alike.

    >>> nearest_names("FPD", ["EDC", "FPI", "FDP"])
    ['FDP']
    """
    word = name.casefold()
    near, letters = [], Counter(word)
    for term in known:
        other = term.casefold()
        allowed, begins = share * max(len(word), len(term)), other.startswith(word)
        shared = (letters & Counter(other)).total()
        if not begins and max(len(word), len(other)) - shared > allowed:
            continue  # each letter that the other lacks takes an edit
        edits = min(_edits(word, other), SWAP) if begins else _edits(word, other)
        if edits <= allowed:
            near.append((edits, term))
    return [term for _, term in sorted(near, key=lambda pair: pair[0])[:most]]


def _edits(a: str, b: str) -> float:
    """The distance of two words by optimal string alignment, of which each letter is changed once
    (Boytsov 2011, ACM J Exp Algorithmics 16:1.1); letters that are swapped weigh SWAP."""
    above: list[float] = []
    row: list[float] = list(range(len(b) + 1))
    for i, letter in enumerate(a):
        above, last, row = row, above, [float(i + 1)]
        for j, other_letter in enumerate(b):
            edits = min(above[j + 1] + 1, row[j] + 1, above[j] + (letter != other_letter))
            if i and j and letter == b[j - 1] and a[i - 1] == other_letter:
                edits = min(edits, last[j - 1] + SWAP)
            row.append(edits)
    return row[-1]


def first_twice(names: Iterable[str]) -> str:
    """The first name that was there before; empty where all differ.

    >>> first_twice(["a", "b", "a", "b"])
    'a'
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return ""


class ReadingWarning(UserWarning):
    """What a file of another program was taken for where it does not say, or says two things; the
    command line shows it as one line."""


class CosimError(Exception):
    """A fault in words for a person: what is wrong, where, what was expected, what to do.

    >>> try:
    ...     raise InputError("hood.mesh.quads: 3 is below 50; write at least 50")
    ... except CosimError as error:
    ...     print(error)
    hood.mesh.quads: 3 is below 50; write at least 50
    """


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with an input, for programs that read errors; its text is a line.

    >>> fault = Fault("hood.thickness", "'3 kg'", "mine.toml", "no unit of length")
    >>> str(fault)
    "hood.thickness = '3 kg' (mine.toml): no unit of length"
    """

    place: str
    """The key, its parts joined by dots."""
    found: str
    """The value that stands there, cut short; empty where there is none."""
    source: str
    """The file that states it; empty where none does."""
    message: str
    """What is wrong, and what was expected."""

    def __str__(self) -> str:
        value = f" = {self.found}" if self.found else ""
        source = f" ({self.source})" if self.source else ""
        return f"{self.place}{value}{source}: {self.message}"


class InputError(CosimError):
    """The user's input is at fault; nothing was computed (exit code 2)."""

    def __init__(self, message: str, faults: Sequence[Fault] = ()) -> None:
        super().__init__(message)
        self.faults = tuple(faults)
        """Each fault of a case file with its place; empty of other input."""

    def __reduce__(self) -> tuple[type[InputError], tuple[str, tuple[Fault, ...]]]:
        return type(self), (str(self), self.faults)  # between processes


def unexpected(place: str, expected: str, given: object) -> InputError:
    """The error for an argument of another kind than expected.

    >>> str(unexpected("steps", "a whole number", "x"))
    "steps: expected a whole number, not 'x' (str)"
    """
    try:
        text = ascii(given)
    except ValueError:  # an integer of thousands of digits
        text = "a huge number"
    shown = text if len(text) <= 60 else f"{text[:57]}..."
    return InputError(f"{place}: expected {expected}, not {shown} ({type(given).__name__})")


class ConvergenceError(CosimError):
    """A solve did not converge; there is no result (exit code 1).

    `reached` is what a motion had reached when a step failed, a Result whose summary says
    `converged: false`; None of all else."""

    def __init__(self, message: str, reached: Any = None) -> None:
        super().__init__(message)
        self.reached = reached


class PatienceError(CosimError):
    """A solve took longer than its case allows; its text says how far it came.  It is no
    ConvergenceError, so that no solver tries another way; who began the solve makes one of it."""


class NoRoomError(CosimError):
    """A result could not be written for want of room on the disk (exit code 1)."""


class NoMemoryError(CosimError):
    """There is not enough memory; there is no result (exit code 1).

    >>> print(str(NoMemoryError.of(MemoryError("Unable to allocate 45 GiB"))).split(";")[0])
    not enough memory: Unable to allocate 45 GiB
    """

    @classmethod
    def of(cls, error: object) -> NoMemoryError:
        """The error in words for what was needed, as a MemoryError says it."""
        needed = " ".join(str(error).split()) or "the system gave no more"
        return cls(
            f"not enough memory: {needed}; a coarser mesh (hood.mesh.quads), fewer stored frames "
            "(output.frames), a shorter motion, a smaller file, or fewer --workers need less"
        )


class StoppedError(CosimError):
    """The user stopped a run before its end; there is no result (exit code 130)."""
