"""The version of the shell solver that a kept equilibrium belongs to."""

from __future__ import annotations

from functools import cache

from cosim.content_key import ROOT, machine, sources_key
from fe_solver.elements import kernels
from fe_solver.solver.linear_algebra import backend_name

KNOWN = ("fe_solver", "cosim.port")
"""Where the classes of a hood come from whose code `solver_version` covers."""
SOURCES = ("fe_solver/**/*.py", "cosim/kernels/*.py", "cosim/port.py", "cosim/processes.py")


def solver_version() -> tuple[object, ...]:
    """What the solver's last digits depend on beside what it solves: its code, the linear solver,
    whether its loops are compiled, the libraries and the machine."""
    return _code(), backend_name(), kernels.COMPILED, *machine()


@cache
def _code() -> str:
    return sources_key(path for pattern in SOURCES for path in ROOT.glob(pattern))
