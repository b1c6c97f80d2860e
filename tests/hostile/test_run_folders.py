"""Folders of runs whose files were damaged or changed: what reads them answers, or says which file
it cannot read."""

from __future__ import annotations

import json
import shutil
import tomllib
import warnings
from collections.abc import Callable, Iterator
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim
from cosim.errors import InputError
from cosim.report.tables import tables_of
from cosim.results import read
from cosim.results.arrays import Arrays, Variable
from cosim.results.parts import CaseParts
from cosim.results.read import read_run
from cosim.results.result import Result
from cosim.results.sto import write_tables
from tests.fuzz.test_readers import mutate
from tests.helpers.folders import forget_digest
from tests.hostile.kills import RAMP

FEW, MANY = 3, 40
"""Of each way to damage a file, in the default run and in the slow one."""
COUNTS = [FEW, pytest.param(MANY, marks=pytest.mark.slow)]
FILES = ("results.nc", "summary.json", "ledger.csv", "case.toml", "hood.vtu")
UNSEEN = ("scenes", "_whole_scene", "data", "quantities")
"""Properties that take long: bones, or what others ask for as well."""
ODD: tuple[Any, ...] = (
    *(None, True, 3, -1e400, "x", "", [], {}, [[1]], {"a": {"b": 1}}, ["audit"]),
    *({"distal": 1}, {"distal": "x", "radial": 1, "dorsal": 2}, [{"a": 1}], 10**400),
)
"""What a value of a summary becomes."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """At rest and in motion, with a shape of the hood and without."""
    at = tmp_path_factory.mktemp("runs")
    bare = {"output.picture": False}
    cases = [cosim.load(name).replace(bare) for name in ("split_edc", "cable_edc")]
    ramp = tomllib.loads(RAMP)
    ramp["forward"].pop("checkpoint")
    return [cosim.run(case).save(at) for case in (*cases, cosim.load(ramp))]


def read_all(folder: Path) -> None:
    """All that a run says when it is read."""
    result = read_run(folder)
    for name, of_class in (*vars(Result).items(), *vars(CaseParts).items()):
        if isinstance(of_class, property | cached_property) and name not in UNSEEN:
            getattr(result, name)
    assert repr(result)
    tables_of([result], None)


def refusals(
    folder: Path,
    damages: Iterator[Any],
    spoil: Callable[[Any], object],
    reader: Callable[[Path], None] = read_all,
) -> list[str]:
    """The messages with which damaged folders were refused; each names a file that is there."""
    said = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for damage in damages:
            spoil(damage)
            try:
                reader(folder)
            except InputError as error:
                said.append(str(error))
                assert str(folder) in str(error)
                assert len(str(error)) < 2000
    return said


def copies(runs: list[Path], tmp_path: Path) -> Iterator[Path]:
    for run in runs:
        yield Path(shutil.copytree(run, tmp_path / run.name))


@pytest.fixture
def arrays_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays that were read are not read again, since that takes longest of all."""
    monkeypatch.setattr(read, "_arrays", cache(read._arrays))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_read_or_refused(
    name: str, count: int, runs: list[Path], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    rng = np.random.default_rng(63)
    reader = write_both_tables if name == "results.nc" else read_all
    if name != "results.nc":
        request.getfixturevalue("arrays_once")
    for folder in copies(runs, tmp_path):
        if (path := folder / name).is_file():
            content = path.read_bytes()
            flips = (_flip(content, rng) for _ in range(count))
            cuts = (content[: len(content) * k // 10] for k in range(0, 10, 3))
            mutants = (mutate(content, rng) for _ in range(count))
            spoilt = (*flips, *cuts, *mutants, b"\0" * 99, b"[" * 99_999, b"a=" + b"[" * 999)
            said = refusals(folder, iter(spoilt), path.write_bytes, reader)
            assert said
            if name == "results.nc":  # of a spoilt one HDF5 reads other numbers, or never ends
                assert len(said) == sum(text != content for text in spoilt)


def write_both_tables(folder: Path) -> None:
    """What reads the arrays."""
    write_tables(folder, folder.parent / "run.sto")
    read_all(folder)


def _flip(content: bytes, rng: np.random.Generator) -> bytes:
    """With some bytes changed, most of them in the head."""
    changed = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        end = len(content) if rng.random() < 0.5 else min(len(content), 4000)
        changed[rng.integers(0, end)] ^= 1 << int(rng.integers(0, 8))
    return bytes(changed)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.usefixtures("arrays_once")
def test_a_summary_of_other_types_is_read_or_refused(
    count: int, runs: list[Path], tmp_path: Path
) -> None:
    rng = np.random.default_rng(63)
    for folder in copies(runs, tmp_path):
        path = folder / "summary.json"
        summary = json.loads(path.read_text())
        ways = list(_ways(summary))
        chosen = [ways[i] for i in rng.permutation(len(ways))[: 5 * count]]
        first = [(key,) for key in summary]
        odd = ((way, ODD[rng.integers(len(ODD))]) for way in (*first, *chosen))
        texts = (json.dumps(_with(summary, way, value)) for way, value in odd)
        assert refusals(folder, texts, path.write_text)


def _ways(value: Any, *way: str) -> Iterator[tuple[str, ...]]:
    if way:
        yield way
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _ways(inner, *way, key)


def _with(table: dict[str, Any], way: tuple[str, ...], value: Any) -> dict[str, Any]:
    first, *rest = way
    return table | {first: _with(table[first], tuple(rest), value) if rest else value}


@pytest.mark.parametrize("count", COUNTS)
def test_arrays_of_another_kind_are_read_or_refused(
    count: int, runs: list[Path], tmp_path: Path
) -> None:
    rng = np.random.default_rng(63)
    for folder in copies(runs, tmp_path):
        path = folder / "results.nc"
        arrays = read_run(folder).arrays
        others = list(_other_arrays(arrays))
        chosen = (others[i] for i in rng.permutation(len(others))[: 2 * count])
        assert refusals(folder, chosen, partial(_write, path), write_both_tables)


def _write(path: Path, arrays: Arrays) -> None:
    arrays.write(path)
    forget_digest(path.parent)


def _other_arrays(arrays: Arrays) -> Iterator[Arrays]:
    """Each without an array or an axis, with one of another type, of other axes, or shorter."""
    for name, (dims, values, attributes) in arrays.variables.items():
        others: dict[str, Variable] = dict(arrays.variables)
        del others[name]
        yield Arrays(others, arrays.coordinates)
        yield Arrays(others | {name: Variable(dims, values.astype(str), {})}, arrays.coordinates)
        yield Arrays(others | {name: Variable((), np.array(1.0), {})}, arrays.coordinates)
        if len(dims) > 1:
            turned = Variable(dims[::-1], values.T, attributes)
            yield Arrays(others | {name: turned}, arrays.coordinates)
            own = tuple(f"my_{dim}" for dim in dims)
            yield Arrays(others | {name: Variable(own, values, {})}, arrays.coordinates)
    for name, (dims, values, _) in arrays.coordinates.items():
        rest = {key: one for key, one in arrays.coordinates.items() if key != name}
        yield Arrays(arrays.variables, rest)
        yield Arrays(arrays.variables, rest | {name: Variable(dims, np.zeros(values.shape), {})})
