"""FMUs for tests: written ones, and archives tampered with."""

from __future__ import annotations

import platform
import sys
import zipfile
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fmu.mapping import VariablePlace, places
from cosim.fmu.table import Loading
from cosim.fmu.unit import Command, Unit
from cosim.fmu_export.run import part_of
from tests.proofs.coupling.fmu_rows import MOTION

NEEDS_FMU = [
    pytest.mark.fmu,
    pytest.mark.skipif(
        any(find_spec(name) is None for name in ("pythonfmu", "pythonfmu3")),
        reason="pythonfmu or pythonfmu3 is not installed",
    ),
    pytest.mark.skipif(
        sys.platform not in ("linux", "win32")
        or platform.machine().lower() not in ("x86_64", "amd64"),
        reason="written FMUs have binaries for Linux and Windows on x86-64",
    ),
]
Change = Callable[[bytes], bytes]
IN_PROCESS = Loading(in_process=True)
"""For tests that put something in the place of what a unit runs."""
SHORT = 'forward={duration="0.02 s",must_rest=false}'
RAMP = 'tendons.EDC.signal={kind="points",at=[["0 s",0.02],["0.01 s",1.0]]}'
FREE = (*MOTION, SHORT, RAMP, 'finger.gravity=["0 m/s**2","0 m/s**2","-9.81 m/s**2"]')


def moving_case(*settings: str) -> Case:
    """A finger with a hood of cables that falls and is pulled, for 20 ms."""
    return load_case("pulley_edc", [*FREE, *settings])


def change_archive(
    source: Path,
    target: Path,
    changes: Mapping[str, Change] | None = None,
    *,
    without: tuple[str, ...] = (),
    more: Mapping[str | zipfile.ZipInfo, bytes] | None = None,
) -> Path:
    """A copy of an archive with some files changed, left out (by their names' starts) or added."""
    changes = dict(changes or {})
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for entry in old.infolist():
            if not entry.filename.startswith(without or ("\0",)):
                change = changes.pop(entry.filename, bytes)
                new.writestr(entry, change(old.read(entry)))
        for name, content in (more or {}).items():
            new.writestr(name, content)
    assert not changes, f"the archive has no {', '.join(changes)}"
    return target


def change_description(source: Path, target: Path, old: str, new: str) -> Path:
    """A copy whose description says `new` where it said `old`."""

    def change(text: bytes) -> bytes:
        assert old.encode() in text, f"the description has no {old}"
        return text.replace(old.encode(), new.encode())

    return change_archive(source, target, {"modelDescription.xml": change})


def places_of(unit: Unit, case: Case, part: str) -> dict[str, VariablePlace]:
    return places(unit.opened, part_of(case, part).quantities, {})


class InitialUnit(Unit):
    """A unit that is still in its initialization mode."""

    def _initialise(self) -> None:
        for call in ("setupExperiment", "enterInitializationMode")[not self.is_fmi2 :]:
            self._do(Command(call, (), InputError, call))

    def leave_initialization(self) -> None:
        """Raises InputError."""
        self._do(Command("exitInitializationMode", (), InputError, "cannot be initialised"))


def run_in_fmpy(path: Path, seconds: float) -> None:
    """FMPy finds no problem in a unit, and runs it so long with finite values."""
    from fmpy import simulate_fmu
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(path)) == []
    result = simulate_fmu(str(path), stop_time=seconds, output_interval=seconds / 10)
    assert result["time"][-1] == pytest.approx(seconds)
    plain = result.view(np.ndarray)
    assert all(np.isfinite(plain[name]).all() for name in plain.dtype.names)
