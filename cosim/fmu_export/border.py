"""The border between a written unit and its simulator, which no exception crosses."""

from __future__ import annotations

from collections.abc import Callable

from cosim.errors import CosimError


def fault_of(call: Callable[[], None]) -> str:
    """What went wrong in a call from the simulator; empty where nothing did.

    An exception that crosses this border ends the simulator's process, so all are told: a panic of
    a compiled library is a BaseException and no Exception.  The user's own Ctrl-C passes."""
    try:
        call()
    except KeyboardInterrupt:
        raise
    except CosimError as error:
        return str(error)
    except BaseException as error:
        return f"a fault of the program, {type(error).__name__}: {error}"
    return ""
