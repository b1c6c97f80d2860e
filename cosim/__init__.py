"""Co-simulation of a finger's extensor hood and its bones: a case in, an audited answer out.

    case = cosim.load("isometric_edc")
    result = cosim.run(case)
    result.tip_force

What is named here is the public face; everything else may change.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cosim.version import __version__

if TYPE_CHECKING:
    from cosim.case.schema import Case
    from cosim.errors import ConvergenceError, InputError
    from cosim.face import compare, couple, list_cases, load, open_run, run, run_many
    from cosim.results.result import Result
    from cosim.solve.session import Session

_HOME = {
    "Case": "cosim.case.schema",
    "ConvergenceError": "cosim.errors",
    "InputError": "cosim.errors",
    "Result": "cosim.results.result",
    "Session": "cosim.solve.session",
    "compare": "cosim.face",
    "couple": "cosim.face",
    "list_cases": "cosim.face",
    "load": "cosim.face",
    "open_run": "cosim.face",
    "run": "cosim.face",
    "run_many": "cosim.face",
}
"""The module of each name: loaded when it is first asked for, so that the port stays light."""
__all__ = [
    "Case",
    "ConvergenceError",
    "InputError",
    "Result",
    "Session",
    "__version__",
    "compare",
    "couple",
    "list_cases",
    "load",
    "open_run",
    "run",
    "run_many",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'cosim' has no attribute {name!r}")
    found = getattr(import_module(_HOME[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
