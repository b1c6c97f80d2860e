"""The unloaded hood kept between processes: the same bytes from any cache, and never another's."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.array_cache import VARIABLE, ArrayCache
from cosim.case.file import load_case
from cosim.cli import app
from cosim.coupling.equilibrium import LOOSE
from cosim.models.build import build
from cosim.pipeline import run_case
from cosim.port import Motion, Response
from fe_solver.hood import version
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.materials.linear import Isotropic
from fe_solver.solver.augmented_contact import AugmentOptions
from tests.helpers import shells
from tests.helpers.conformance import index_motions

SMALL = ("--set", "hood.mesh.quads=120", "--set", "solve.hood_tolerance=1e-6")


@dataclass
class Runs:
    """A small case, run again and again, and how often its hood was solved as it is laid."""

    folder: Path
    cache: ArrayCache
    solves: list[str]

    def run(self, name: str) -> dict[str, bytes]:
        """The files of a run, without its seconds."""
        out = self.folder / name
        words = ["run", "isometric_edc", *SMALL, "--quiet", "--no-pictures", "--out", str(out)]
        done = CliRunner().invoke(app, words)
        assert done.exit_code in (0, 3), done.output
        files = {path.name: path.read_bytes() for path in (out / "isometric_edc").iterdir()}
        summary = json.loads(files["summary.json"])
        assert summary.pop("wall_s") > 0
        return {**files, "summary.json": json.dumps(summary).encode()}

    def kept(self) -> Path:
        (file,) = (self.cache.folder / "equilibria").iterdir()
        return file


@pytest.fixture(scope="module")
def surfaces() -> None:
    """The bones' distances in this process, from the user's cache."""
    build(load_case("isometric_edc"))


@pytest.fixture
def runs(surfaces: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Runs:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    solves, advance = [], ShellHood.advance

    def watched(self: ShellHood, state: HoodState, *at: Any) -> Response:
        if state.solution is None:
            solves.append("solved")
        return advance(self, state, *at)

    monkeypatch.setattr(ShellHood, "advance", watched)
    return Runs(tmp_path, ArrayCache(tmp_path / "cache"), solves)


def _flip(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


def test_results_have_the_same_bytes_whatever_the_cache_holds(runs, monkeypatch):
    cold = runs.run("cold")
    assert runs.solves == ["solved"]
    assert {"results.nc", "summary.json", "ledger.csv"} <= set(cold)
    whole = runs.kept().read_bytes()
    assert runs.run("warm") == cold
    assert runs.solves == ["solved"]
    spoilt: tuple[Callable[[bytes], bytes], ...] = (_flip, lambda c: c[: len(c) // 3])
    for times, spoil in enumerate(spoilt, 2):
        runs.kept().write_bytes(spoil(whole))
        assert runs.run(f"spoilt {times}") == cold
        assert len(runs.solves) == times
        assert runs.kept().stat().st_size == len(whole)
    for times, place in enumerate(("off", str(runs.kept())), 4):  # the second is no folder
        monkeypatch.setenv(VARIABLE, place)
        assert runs.run(f"without {times}") == cold
        assert len(runs.solves) == times


def _spoil(name: str, change: Callable[[np.ndarray], Any]) -> Callable[[dict], dict]:
    return lambda arrays: {**arrays, name: np.asarray(change(arrays[name]))}


FORGED: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "zeros": _spoil("x", lambda x: 0 * x),
    "no numbers": _spoil("x", lambda x: np.nan * x),
    **{
        f"node {node} a micrometre away": _spoil(
            "x", lambda x, node=node: x + 1e-6 * (np.arange(len(x)) == node)[:, None]
        )
        for node in (3, 50, 101)
    },
    "longer directors": _spoil("d", lambda d: 1.01 * d),
    "other tensions": _spoil("tension", lambda t: t + 0.1),
    "other poses": _spoil("position", lambda p: p + 1e-4),
    "poses that it was not asked for": _spoil("motion/position", lambda p: p + 1e-4),
    "fewer tensions": _spoil("tension", lambda t: t[:-1]),
    "words": _spoil("x", lambda x: x.astype(str)),
    "one number": _spoil("counts", lambda _: 3),
    "no solution": lambda arrays: {k: v for k, v in arrays.items() if k != "tension"},
    "nothing": lambda _: {},
}


FEW = ("node 50 a micrometre away", "other tensions", "words")
"""Forged in a default run; in a slow one all are."""


@pytest.mark.parametrize("names", [FEW, pytest.param([*FORGED], marks=pytest.mark.slow)])
def test_an_entry_that_is_no_equilibrium_is_dropped_and_solved_anew(runs, names):
    """Whoever can write into the folder can make a digest too: its numbers must solve."""
    cold, file = runs.run("cold"), runs.kept()
    whole, arrays = file.read_bytes(), runs.cache.read("equilibria", file.stem)
    assert arrays is not None
    for times, what in enumerate(names, 2):
        runs.cache.write("equilibria", file.stem, FORGED[what](arrays))
        assert runs.run(what) == cold, what
        assert len(runs.solves) == times, what
        assert file.read_bytes() == whole


@pytest.mark.slow
def test_of_another_version_of_the_solver_nothing_is_used(runs, monkeypatch):
    first = runs.run("one")
    monkeypatch.setattr(version, "_code", lambda: "another")
    assert runs.run("other") == first
    assert len(runs.solves) == 2
    assert len(list((runs.cache.folder / "equilibria").iterdir())) == 2


@pytest.fixture(scope="module")
def motion() -> Motion:
    return index_motions()[1]


def key_of(hood: ShellHood, motion: Motion, tension: np.ndarray | None = None) -> str | None:
    tension = np.zeros(len(hood.tendons)) if tension is None else tension
    return hood.first_key(hood.start(motion), motion, tension)


OTHERS = (
    "hood.regions.central_slip.modulus=90 MPa",
    "hood.springs.sagittal_radial.slack=0.1 mm",
    "hood.contact.offset.proximal=0.7 mm",
    "hood.contact.stiffness=2 N/mm^3",
    "hood.extra_length.terminal_slip=0.1 mm",
)


def test_what_determines_the_answer_is_in_its_key(motion, monkeypatch):
    hood = shells.index_hood()
    key = key_of(hood, motion)
    assert key is not None
    assert key == key_of(replace(hood), motion)
    keys = [key_of(shells.index_hood(other), motion) for other in OTHERS]
    keys.append(key_of(hood.with_tolerance(LOOSE), motion))
    keys.append(key_of(hood, index_motions()[0]))
    keys.append(key_of(hood, motion, np.full(len(hood.tendons), 1e-3)))
    for name, value in (("FE_SOLVER_LINEAR", "superlu"), ("NUMBA_OPT", "1")):
        monkeypatch.setenv(name, value)
        keys.append(key_of(hood, motion))
        monkeypatch.delenv(name)
    assert len({key, *keys}) == 1 + len(keys)
    assert None not in keys


class OwnLaw(Isotropic):
    """A law of a user's, whose code no key covers."""


def test_what_cannot_be_kept_whole_has_no_key(motion):
    hood = shells.index_hood()
    tension = np.ones(len(hood.tendons))
    assert key_of(replace(hood, augment=AugmentOptions(penetration=1e-6)), motion) is None
    section = hood.model.section
    (patch, *more) = section.patches
    own = replace(section, patches=(replace(patch, law=OwnLaw(1e8, 0.3)), *more))
    assert key_of(replace(hood, model=hood.model.with_changes(section=own)), motion) is None
    solved = hood.advance(hood.start(motion), motion, tension, 0.0).state
    assert hood.first_key(solved, motion, tension) is None


def test_arrays_hold_how_a_state_was_reached(motion):
    hood = shells.index_hood()
    state = hood.advance(hood.start(motion), motion, np.ones(len(hood.tendons)), 0.0).state
    assert state.attempt
    again = hood.from_arrays(hood.to_arrays(state))
    assert (again.attempt, again.iterations) == (state.attempt, state.iterations)
    assert again.solution.solves == state.solution.solves


WAYS = {
    "motion": ("motion_edc_fdp", "forward.duration=2 ms", "hood.mesh.quads=150"),
    "one way": ("thesis_one_way_edc", "hood.mesh.quads=150"),
    "fixed point": ("cable_edc", "coupling.scheme=implicit", shells.COARSE_NET),
}


@pytest.mark.parametrize("way", WAYS)
def test_whatever_begins_as_laid_begins_from_the_cache(runs, way):
    name, *settings = WAYS[way]
    first, again = (run_case(load_case(name, settings)) for _ in range(2))
    assert runs.solves == ["solved"]
    for array in first.data.data_vars:
        assert first.data[array].values.tobytes() == again.data[array].values.tobytes()
