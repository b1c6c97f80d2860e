"""The errors that a person reads, and how a caller follows a long solve."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str], None]
"""A function that is called with a line of text at each stage of what takes long."""


def quiet(text: str) -> None:
    """The progress of a caller who asks for none."""


class CosimError(Exception):
    """A fault in words for a person: what is wrong, where, what was expected, what to do.

    >>> try:
    ...     raise InputError("hood.mesh.quads: 3 is below 50; write at least 50")
    ... except CosimError as error:
    ...     print(error)
    hood.mesh.quads: 3 is below 50; write at least 50
    """


class InputError(CosimError):
    """The user's input is at fault; nothing was computed (exit code 2)."""


class ConvergenceError(CosimError):
    """A solve did not converge; there is no result (exit code 1)."""


class StoppedError(CosimError):
    """The user stopped a run before its end; there is no result (exit code 130)."""
