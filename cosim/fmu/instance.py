"""The instance of an FMU's library, and its saved states: the part that runs foreign code, in a
process of its own or in this one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import chdir
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from cosim.processes import remove_at_orphaning

MOST_LOGGED = 5


@dataclass(frozen=True)
class LibraryFacts:
    """What is needed to load the library of an unpacked FMU."""

    name: str
    folder: str
    token: str
    """GUID or instantiation token."""
    identifier: str
    is_fmi2: bool


Calls = Sequence[tuple[str, tuple[Any, ...]]]
"""Names of methods, of FMPy's or of `Instance`'s own, and their arguments."""
Answers = tuple[list[Any], str]
"""What the calls returned up to the first that failed, and why that did: what the unit logged, or
else the error; empty where none failed."""


class Instance:
    """An instance of an FMU's library: loaded and instantiated by its first two calls."""

    def __init__(self, facts: LibraryFacts) -> None:
        self._facts = facts
        self._log: list[str] = FMI2_LOG if facts.is_fmi2 else []
        self._fmu: Any = None
        self._states: dict[int, Any] = {}
        self._is_made = False

    def do(self, calls: Calls) -> Answers:
        """What the calls return; the first one that fails ends them."""
        out: list[Any] = []
        if self._facts.is_fmi2:
            _listening()
        for name, args in calls:
            self._log.clear()
            try:
                out.append((getattr(self, name, None) or getattr(self._fmu, name))(*args))
            except Exception as failure:  # FMPy raises Exception itself
                reason = "; ".join(self._log[-MOST_LOGGED:]) or str(failure)
                return out, reason or type(failure).__name__
        return out, ""

    def load(self) -> None:
        """Load the library."""
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        facts = self._facts
        with chdir("."):  # FMPy changes the folder and stays there where a library does not load
            self._fmu = (FMU2Slave if facts.is_fmi2 else FMU3Slave)(
                instanceName=facts.name,
                guid=facts.token,
                modelIdentifier=facts.identifier,
                unzipDirectory=facts.folder,
            )

    def create(self) -> None:
        """Instantiate it."""
        logger: dict[str, Any] = {"logMessage": _logger(self._log)}
        if self._facts.is_fmi2:
            logger = {"callbacks": _listening()}
        self._fmu.instantiate(loggingOn=True, **logger)
        self._is_made = True

    def save(self, key: int) -> None:
        """Save the state under a key."""
        self._states[key] = self._fmu.getFMUState()

    def restore(self, key: int) -> None:
        """Go back to the state of a key."""
        self._fmu.setFMUState(self._states[key])

    def forget(self, keys: Sequence[int]) -> None:
        """Free the states of these keys."""
        for key in keys:
            self._fmu.freeFMUState(self._states.pop(key))

    def serialise(self, key: int) -> bytes:
        """The state of a key as bytes."""
        content: bytes = self._fmu.serializeFMUState(self._states[key])
        return content

    def read(self, key: int, content: bytes) -> None:
        """Put the state that `serialise` made under a key."""
        self._states[key] = self._fmu.deserializeFMUState(content)

    def free(self) -> None:
        """States are freed before their instance, if there is one."""
        self.forget(list(self._states))
        if self._is_made:
            self._fmu.freeInstance()


_INSTANCES: dict[int, Instance] = {}
"""Those of a process of its own, by their numbers."""


def begin(number: int, facts: LibraryFacts) -> None:
    """Make a number stand for an instance in this process."""
    remove_at_orphaning(Path(facts.folder))
    _INSTANCES[number] = Instance(facts)


def do(number: int, calls: Calls) -> Answers:
    """`Instance.do` of the instance of a number."""
    return _INSTANCES[number].do(calls)


def free(number: int) -> None:
    """Free the instance of a number."""
    _INSTANCES.pop(number).free()


def _logger(log: list[str]) -> Callable[..., None]:
    def write_line(*facts: Any) -> None:
        log.append(" ".join(facts[-1].decode("utf-8", "replace").split()))

    return write_line


FMI2_LOG: list[str] = []
"""What units of FMI 2 log: FMPy's proxy, which puts their messages together, has one listener for
all of a process, whichever was named last."""


@cache
def _listener() -> Any:
    """The listener that fills FMI2_LOG; it outlives every unit, since a proxy that calls one that
    is gone brings the process down."""
    from fmpy import fmi2

    return fmi2.fmi2CallbackLoggerTYPE(_logger(FMI2_LOG))


def _listening() -> Any:
    """FMI 2's table of callbacks, once the proxy calls our listener."""
    from ctypes import byref

    from fmpy import calloc, fmi2, free
    from fmpy.logging import addLoggerProxy

    table = fmi2.fmi2CallbackFunctions()
    table.logger = _listener()
    table.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
    table.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
    addLoggerProxy(byref(table))
    return table
