"""Where the time of a run goes: its parts by name, with their calls, factorisations and seconds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from time import perf_counter


@dataclass
class Part:
    """How often a part of a run was gone through, and what was spent in it."""

    calls: int = 0
    seconds: float = 0.0
    """With those of the parts within."""
    factorisations: int = 0
    """How often a tangent was factorised, with those of the parts within."""


@dataclass
class Stopwatch:
    """The parts of what runs within `stopwatch()`, by the names that lead to each, in the order in
    which they began."""

    parts: dict[tuple[str, ...], Part] = field(default_factory=dict)
    way: tuple[str, ...] = ()

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Add what goes on within to the part of that name, within the one that is open."""
        outer, self.way = self.way, (*self.way, name)
        part, begun = self.parts.setdefault(self.way, Part()), perf_counter()
        part.calls += 1
        try:
            yield
        finally:
            part.seconds += perf_counter() - begun
            self.way = outer


_RUNNING: ContextVar[Stopwatch] = ContextVar("stopwatch")


@contextmanager
def stopwatch() -> Iterator[Stopwatch]:
    """Measure what this thread does within.

    >>> with stopwatch() as watch:
    ...     for _ in range(2):
    ...         with timed("outer"), timed("inner"):
    ...             count_factorisation()
    >>> [(way, part.calls, part.factorisations) for way, part in watch.parts.items()]
    [(('outer',), 2, 2), (('outer', 'inner'), 2, 2)]
    """
    watch = Stopwatch()
    token = _RUNNING.set(watch)
    try:
        yield watch
    finally:
        _RUNNING.reset(token)


@contextmanager
def timed(name: str) -> Iterator[None]:
    """A part of a run, measured if anybody does; of a function as a decorator."""
    watch = _RUNNING.get(None)
    if watch is None:
        yield
        return
    with watch.measure(name):
        yield


def count_factorisation() -> None:
    """Count one in each part that is open."""
    watch = _RUNNING.get(None)
    if watch is not None:
        for k in range(len(watch.way)):
            watch.parts[watch.way[: k + 1]].factorisations += 1
