"""What goes wrong, told to a person; and how a caller hears how far a long solve has come."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str], None]
"""Is told of each stage of what takes long, in a line."""


def quiet(text: str) -> None:
    """The progress of a caller who asks for none."""


class CosimError(Exception):
    """A fault told to a person: what is wrong, where, what was expected, what to do."""


class InputError(CosimError):
    """The user's input is at fault; nothing was computed (exit code 2)."""


class ConvergenceError(CosimError):
    """A solve did not converge; there is no result (exit code 1)."""


class StoppedError(CosimError):
    """The user stopped a run before its end; there is no result (exit code 130)."""
