"""Arguments of the Python face that are of another kind: each is refused in words, or serves."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim
from cosim.errors import CosimError
from cosim.results.result import Result

ODD: dict[str, Any] = {
    "none": None,
    "false": False,
    "zero": 0,
    "negative": -1,
    "huge": 10**400,
    "fraction": 0.5,
    "nan": float("nan"),
    "complex": 1j,
    "empty": "",
    "word": "no such thing",
    "nul": "a\0b",
    "half a character": "\ud800",
    "long": "x" * 5000,
    "bytes": b"pulley_edc",
    "list": [],
    "list of None": [None],
    "table": {},
    "table of numbers": {1: 2},
    "table of tables": {"EDC": {"a": []}},
    "set": {1},
    "array": np.zeros((2, 2)),
    "text of numpy": np.str_("pulley_edc"),
    "number of numpy": np.float64(3.0),
    "object": object(),
    "class": dict,
    "function": len,
    "generator": (n for n in "ab"),
    "path": Path("no/such/path"),
}


@cache
def a_result() -> Result:
    return cosim.run(cosim.load("pulley_edc").replace({"output.picture": False}))


def calls(out: Path) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Functions with arguments that serve, by name."""
    case = cosim.load("pulley_edc")
    result = a_result()
    return {
        "load": (cosim.load, {"case": "pulley_edc", "settings": []}),
        "run": (cosim.run, {"case": case, "session": None}),
        "run_many": (cosim.run_many, {"cases": [case], "workers": 1}),
        "open_run": (cosim.open_run, {"folder": out}),
        "moment_arms": (cosim.moment_arms, {"case": case, "steps": 3}),
        "estimate": (cosim.estimate, {"case": "split_edc", "force": {"distal": -1.0}}),
        "estimate torques": (cosim.estimate, {"case": "split_edc", "torques": {"PIP": 0.01}}),
        "couple": (
            cosim.couple,
            {
                **{"finger": case, "hood": case, "tensions": {"EDC": 3.0}, "posture": None},
                **{"resting": 0.0, "tolerance": 1e-6, "max_iterations": 9},
            },
        ),
        "Session": (cosim.Session, {"most": 2}),
        "replace": (case.replace, {"values": {"tendons.EDC.tension": "1 N"}, "name": "a"}),
        "plot": (lambda kind, path: result.plot(kind, path), {"kind": "scene", "path": None}),
        "save": (result.save, {"folder": out}),
        "identify": (cosim.identify, {"cases": case, "targets": out, "free": None, "most": 1}),
        "run_study": (cosim.run_study, {"study": out, "out": out, "workers": 1}),
        "write_report": (
            lambda run, data: cosim.write_report(run, out=out / "a.html", data=data),
            {"run": out, "data": None},
        ),
        "compare": (lambda run, data: cosim.compare(run, data=data), {"run": result, "data": None}),
    }


NAMES = (
    *("load", "run", "run_many", "open_run", "moment_arms", "estimate", "estimate torques"),
    *("couple", "Session", "replace", "plot", "save", "identify", "run_study"),
    *("write_report", "compare"),
)


@pytest.mark.parametrize("name", NAMES)
def test_an_odd_argument_serves_or_is_refused_in_words(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    function, arguments = calls(tmp_path)[name]
    wrong = []
    for argument in arguments:
        for odd, value in ODD.items():
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    function(**(arguments | {argument: value}))
            except CosimError as error:
                assert str(error).encode()
            except Exception as error:
                wrong.append(f"{argument} = {odd}: {type(error).__name__}: {str(error)[:90]}")
    assert not wrong, "\n".join(wrong)
