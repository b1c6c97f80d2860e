"""Co-simulation of a finger's extensor hood and its bones: a case in, an audited answer out.

    >>> import cosim
    >>> case = cosim.load("pulley_edc")
    >>> result = cosim.run(case)
    >>> sorted(result.tip_force)  # N, along the world's axes
    ['distal', 'dorsal', 'radial']

What is named here is the public face; everything else may change.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from cosim.version import __version__

if sys.version_info < (3, 11):  # noqa: UP036  this file can be read by older ones
    _TOO_OLD = (
        f"cosim needs Python 3.11 or newer, and this is {sys.version_info[0]}."
        f"{sys.version_info[1]} ({sys.executable})"
    )
    if sys.argv[:1] == ["-m"]:  # python -m cosim
        print(_TOO_OLD, file=sys.stderr)
        raise SystemExit(2)
    raise ImportError(_TOO_OLD)

if TYPE_CHECKING:
    from cosim.case.schema import Case
    from cosim.errors import ConvergenceError, InputError
    from cosim.face import (
        compare,
        converge,
        couple,
        estimate,
        identify,
        list_cases,
        load,
        moment_arms,
        open_run,
        plot_over,
        run,
        run_many,
        run_study,
        score,
        track,
        validate,
        write_report,
    )
    from cosim.loop import Loop
    from cosim.results.result import Result
    from cosim.solve.session import Session

_HOME = {
    "Case": "cosim.case.schema",
    "ConvergenceError": "cosim.errors",
    "InputError": "cosim.errors",
    "Loop": "cosim.loop",
    "Result": "cosim.results.result",
    "Session": "cosim.solve.session",
    "compare": "cosim.face",
    "converge": "cosim.face",
    "couple": "cosim.face",
    "estimate": "cosim.face",
    "identify": "cosim.face",
    "list_cases": "cosim.face",
    "load": "cosim.face",
    "moment_arms": "cosim.face",
    "open_run": "cosim.face",
    "plot_over": "cosim.face",
    "run": "cosim.face",
    "run_many": "cosim.face",
    "run_study": "cosim.face",
    "score": "cosim.face",
    "track": "cosim.face",
    "validate": "cosim.face",
    "write_report": "cosim.face",
}
"""The module of each name: loaded when it is first asked for, so that the port stays light."""
__all__ = [
    "Case",
    "ConvergenceError",
    "InputError",
    "Loop",
    "Result",
    "Session",
    "__version__",
    "compare",
    "converge",
    "couple",
    "estimate",
    "identify",
    "list_cases",
    "load",
    "moment_arms",
    "open_run",
    "plot_over",
    "run",
    "run_many",
    "run_study",
    "score",
    "track",
    "validate",
    "write_report",
]


_NEIGHBOURS = {
    "cases": "base",
    "fe_solver": "solver",
    "meshes": "skeleton.py",
    "rigid": "model.py",
}
"""The packages that are installed with this one, and something that each holds."""


def _check_neighbours() -> None:
    """Raise ImportError where a file of the user's own has the name of one of them and comes first
    on Python's path."""
    for name, inner in _NEIGHBOURS.items():
        try:
            spec = find_spec(name)
        except ValueError:  # a module that was made by hand
            continue
        origin = spec.origin if spec is not None else None
        if origin and not os.path.exists(os.path.join(os.path.dirname(origin), inner)):
            raise ImportError(
                f"cosim needs the package {name} that was installed with it, but Python finds "
                f"{origin} first. Rename that file or folder, or start Python in another folder."
            )


_check_neighbours()


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'cosim' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
