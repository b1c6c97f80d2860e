"""Arithmetic that a file writes as text, parsed and evaluated by us: nothing of it is ever run.

Operators, functions and constants are those of FEBio's user manual (appendix C): `log` is to base
10, `ln` the natural one, `^` the power.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError

Number = float | NDArray[np.float64]
MOST_LETTERS = 1000
NUMBER = re.compile(r"(?<![\w.])[\d.][\w.]*")
PLAIN = re.compile(r"(\d+\.?\d*|\.\d+)([eE]\d*)?")
CONSTANTS = {"pi": math.pi, "e": math.e, "gamma": 0.5772156649015329}
ONE: dict[str, Callable[[Any], Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "csc": lambda x: 1 / np.sin(x),
    "sec": lambda x: 1 / np.cos(x),
    "cot": lambda x: 1 / np.tan(x),
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "exp": np.exp,
    "ln": np.log,
    "log": np.log10,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sgn": np.sign,
    "sinc": lambda x: np.sinc(x / np.pi),
    "H": lambda x: np.heaviside(x, 0.5),
    "step": lambda x: np.heaviside(x, 1.0),
}
"""Functions of one number."""
TWO: dict[str, Callable[[Any, Any], Any]] = {"pow": np.power, "atan2": np.arctan2}
"""Functions of two."""
MANY: dict[str, Callable[..., Any]] = {
    "min": lambda *x: reduce(np.minimum, x),
    "max": lambda *x: reduce(np.maximum, x),
    "avg": lambda *x: sum(x) / len(x),
}
"""Functions of one or more."""
BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}


@dataclass(frozen=True)
class Expression:
    """A formula of some variables.

    Raises InputError where it is no arithmetic, names what is not known, or is too long.

    >>> from fe_solver.job.expressions import Expression
    >>> Expression("-2*t^2 + max(t, 1)", ("t",)).value({"t": 3.0})
    -15.0
    """

    text: str
    variables: tuple[str, ...]
    """Those that it may name."""

    def __post_init__(self) -> None:
        if not self.text.strip() or len(self.text) > MOST_LETTERS:
            raise self._fault(f"expected a formula of 1 to {MOST_LETTERS} letters")
        try:
            self._check(_parsed(self.text))
        except (SyntaxError, ValueError, OverflowError, RecursionError, MemoryError) as error:
            raise self._fault("it is no arithmetic") from error

    @cached_property
    def used(self) -> frozenset[str]:
        """The variables that it names."""
        names = {n.id for n in ast.walk(_parsed(self.text)) if type(n) is ast.Name}
        return frozenset(names) & frozenset(self.variables)

    def value(self, values: Mapping[str, Number]) -> Number:
        """The value at those of the variables, numbers or arrays of one shape.  Raises InputError
        where it is not finite."""
        with np.errstate(all="ignore"):
            out = np.asarray(_evaluated(_parsed(self.text), values), dtype=float)
        if not np.isfinite(out).all():
            at = ", ".join(f"{k} = {v:g}" for k, v in values.items() if np.ndim(v) == 0)
            raise InputError(f"the formula {self.text!r} has no finite value at {at or 'a place'}")
        return float(out) if out.ndim == 0 else out

    def _check(self, node: ast.expr) -> None:
        match node:
            case ast.Constant(value=int() | float() as number) if type(number) is not bool:
                if not math.isfinite(number):
                    raise self._fault(f"{number!r} is no finite number")
            case ast.Name(id=name):
                if name not in self.variables and name not in CONSTANTS:
                    names = ", ".join((*self.variables, *CONSTANTS))
                    raise self._fault(f"{name!r} is not known; known here: {names}")
            case ast.BinOp(left=left, op=op, right=right) if type(op) in BINARY:
                self._check(left)
                self._check(right)
            case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=inner):
                self._check(inner)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                self._check_call(name, arguments)
            case _:
                raise self._fault("expected numbers, variables, + - * / ^, brackets and functions")

    def _check_call(self, name: str, arguments: list[ast.expr]) -> None:
        count = 1 if name in ONE else 2 if name in TWO else len(arguments)
        if name not in {*ONE, *TWO, *MANY}:
            raise self._fault(
                f"the function {name!r} is not known; known: {', '.join((*ONE, *TWO, *MANY))}"
            )
        if len(arguments) != count or not count:
            raise self._fault(f"{name} takes {count or 'one or more'} numbers")
        for argument in arguments:
            self._check(argument)

    def _fault(self, words: str) -> InputError:
        text = self.text if len(self.text) <= 60 else self.text[:57] + "..."
        return InputError(f"the formula {text!r}: {words}")


def split_formulas(text: str) -> list[str]:
    """The formulas of a list, between the commas that stand in no brackets."""
    depth, out = 0, [""]
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            out.append("")
        else:
            out[-1] += letter
    return [part.strip() for part in out]


@lru_cache(maxsize=256)
def _parsed(text: str) -> ast.expr:
    """The tree of a formula, its numbers plain: without `_`, base prefixes or `j`."""
    if not all(map(PLAIN.fullmatch, NUMBER.findall(text))):
        raise ValueError(text)
    return ast.parse(" ".join(text.split()).replace("^", "**"), mode="eval").body


def _evaluated(node: ast.expr, values: Mapping[str, Number]) -> Any:
    """The value of a checked formula."""
    match node:
        case ast.Constant(value=int() | float() as number):
            return np.float64(number)
        case ast.Name(id=name):
            return values[name] if name in values else CONSTANTS[name]
        case ast.BinOp(left=left, op=op, right=right):
            return BINARY[type(op)](_evaluated(left, values), _evaluated(right, values))
        case ast.UnaryOp(op=op, operand=inner):
            value = _evaluated(inner, values)
            return -value if type(op) is ast.USub else value
        case ast.Call(func=ast.Name(id=name), args=arguments):
            functions: dict[str, Callable[..., Any]] = {**ONE, **TWO, **MANY}
            return functions[name](*(_evaluated(a, values) for a in arguments))
    raise ValueError(ast.dump(node))
