"""The number that a text states: one rule for the files of all programs."""

from __future__ import annotations

MOST_NUMBER = 1e30
"""A magnitude beyond which squares and their products leave the range of floating point."""
RANGE = f"finite, at most {MOST_NUMBER:g}"


def is_plain(text: str) -> bool:
    """Whether a text has nothing that Python reads as part of a number and no other program does:
    digits of other scripts, and underscores.

    >>> is_plain("1e3"), is_plain("1_000"), is_plain("\u0661")
    (True, False, False)
    """
    return text.isascii() and "_" not in text


def read_numbers(text: str) -> list[float] | None:
    """The finite numbers of a text, in plain digits with blanks between; None where something else
    stands there, or a number beyond MOST_NUMBER.

    >>> read_numbers(" -1.5e3 2 "), read_numbers("1_0"), read_numbers("inf 1"), read_numbers("")
    ([-1500.0, 2.0], None, None, [])
    """
    if not is_plain(text):
        return None
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return None
    return values if all(-MOST_NUMBER <= value <= MOST_NUMBER for value in values) else None


def read_number(text: str) -> float | None:
    """The one number of a text, as `read_numbers`."""
    values = read_numbers(text)
    return values[0] if values is not None and len(values) == 1 else None


def read_whole_number(text: str) -> int | None:
    """The whole number from 0 of a text in plain digits, at most eighteen; None where it is none.

    >>> read_whole_number("12"), read_whole_number("1.5"), read_whole_number("\u00b2")
    (12, None, None)
    """
    plain = text.isascii() and text.isdecimal() and len(text) <= 18
    return int(text) if plain else None
