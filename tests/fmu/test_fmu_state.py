"""States of FMUs as bytes: another instance goes on to the same bits, and takes nothing else."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import ConvergenceError, InputError, StoppedError
from cosim.fmu.mapping import VariablePlace
from cosim.fmu.unit import Unit
from cosim.fmu_export.run import PARTS, UnitRun
from cosim.fmu_export.state import Snapshot
from cosim.fmu_export.write import write_fmu
from cosim.pipeline import run_case
from cosim.solve.session import Session
from tests.helpers.fmus import NEEDS_FMU, change_description, moving_case, places_of
from tests.helpers.motions import identical
from tests.proofs.coupling.fmu_rows import MOTION, MOTION_OF_UNITS, in_units

pytestmark = NEEDS_FMU
BOTH = pytest.mark.parametrize("fmi", [2, 3])
STILL = load_case("pulley_edc")
SHELL = ("hood.mesh.quads=120",)
CASES = {
    "still": lambda: STILL,
    "moving": moving_case,
    "shell": lambda: load_case("isometric_edc", SHELL),
    "shell in motion": lambda: load_case("isometric_edc", [*SHELL, *MOTION]),
}


def continue_unit(unit: Unit, place: dict[str, VariablePlace]) -> dict[str, np.ndarray]:
    """All outputs after two more steps under other tensions."""
    for factor in (1.5, 0.7):
        pull(unit, place, factor)
        unit.step(0.002)
    return {name: unit.get(where) for name, where in place.items() if not where.switch}


def pull(unit: Unit, place: dict[str, VariablePlace], tension: float) -> None:
    unit.set(place["tension"], np.full(place["tension"].shape, tension))


@pytest.mark.parametrize(
    ("name", "part", "fmi"),
    [
        *((name, part, fmi) for name in ("still", "moving") for part in PARTS for fmi in (2, 3)),
        pytest.param("shell", "hood", 2, marks=pytest.mark.slow),
        pytest.param("shell in motion", "coupled", 2, marks=pytest.mark.slow),
        pytest.param("shell", "hood", 3, marks=pytest.mark.slow),
        pytest.param("shell", "coupled", 2, marks=pytest.mark.slow),
        pytest.param("shell", "coupled", 3, marks=pytest.mark.slow),
        pytest.param("shell in motion", "coupled", 3, marks=pytest.mark.slow),
    ],
)
def test_another_instance_goes_on_to_the_same_bits(tmp_path, name, part, fmi):
    case, path = CASES[name](), tmp_path / "unit.fmu"
    write_fmu(case, part, fmi, path)
    one = Unit(path)
    place = places_of(one, case, part)
    pull(one, place, 2.0)
    one.step(0.003)
    saved = one.save()
    content = one.serialise(saved)
    assert content == one.serialise(saved)
    expected = continue_unit(one, place)
    other = Unit(path)
    read = other.read(content, saved.time)
    assert other.serialise(read) == content
    other.restore(read)
    assert other.serialise(other.save()) == content
    found = continue_unit(other, place)
    assert other.time == one.time
    for key, value in expected.items():
        assert np.array_equal(found[key], value), key
    assert any(np.any(value) for value in expected.values())


@BOTH
def test_a_state_before_the_first_step_is_one_too(tmp_path, fmi):
    write_fmu(STILL, "coupled", fmi, tmp_path / "unit.fmu")
    one, other = Unit(tmp_path / "unit.fmu"), Unit(tmp_path / "unit.fmu")
    content, place = one.serialise(one.save()), places_of(one, STILL, "coupled")
    other.step(0.01)
    other.restore(other.read(content, 0.0))
    found, expected = (continue_unit(unit, place) for unit in (other, one))
    assert all(np.array_equal(found[name], value) for name, value in expected.items())


def test_the_time_of_fmi_3_comes_with_the_state(tmp_path):
    write_fmu(STILL, "hood", 3, tmp_path / "unit.fmu")
    one, other = Unit(tmp_path / "unit.fmu"), Unit(tmp_path / "unit.fmu")
    time = next(v for v in one.opened.description.modelVariables if v.name == "time")
    one.step(0.25)
    other.restore(other.read(one.serialise(one.save()), 0.25))
    assert other.get(VariablePlace((time.valueReference,), (), False)) == 0.25


def forge(content: bytes, **arrays: np.ndarray) -> bytes:
    """A state with some of its arrays replaced."""
    with np.load(io.BytesIO(content)) as file:
        kept = {name: file[name] for name in file.files}
    out = io.BytesIO()
    np.savez(out, **{**kept, **arrays})
    return out.getvalue()


@BOTH
def test_nothing_else_is_taken_for_a_state(tmp_path, fmi):
    write_fmu(STILL, "finger", fmi, tmp_path / "unit.fmu")
    write_fmu(STILL, "hood", fmi, tmp_path / "other.fmu")
    unit, stranger = Unit(tmp_path / "unit.fmu"), Unit(tmp_path / "other.fmu")
    good = unit.save()
    content = unit.serialise(good)
    pickled = forge(content, **{"state/angles": np.array([{}], dtype=object)})
    bad = {
        "no whole state": [b"\x80\x04a pickle", content[:100], content[:-30], pickled],
        "another unit": [stranger.serialise(stranger.save())],
        "not given out by this unit": [forge(content, values=np.zeros(3))],
        "also holds": [forge(content, **{"state/more": np.zeros(1)})],
    }
    for words, contents in bad.items():
        for text in contents:
            unit.restore(unit.read(text, 0.0))
            with pytest.raises(ConvergenceError, match=words):
                unit.step(0.01)
    unit.restore(good)
    unit.step(0.01)


def run_of(path: Path, folder: Path) -> UnitRun:
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return UnitRun(folder / "resources")


def test_objects_from_outside_are_never_taken(tmp_path):
    write_fmu(STILL, "hood", 2, tmp_path / "unit.fmu")
    run = run_of(tmp_path / "unit.fmu", tmp_path)
    for state in (b"a pickle, for example", Snapshot("", 0.0, np.zeros(3), None, {}), None):
        run.restore(state)
        assert "not given out by this unit" in run.step(0.0, 0.01)


def test_a_step_leaves_a_saved_state_as_it_was(tmp_path):
    """One that is kept in memory, after inputs that no step has seen."""
    write_fmu(STILL, "hood", 2, tmp_path / "unit.fmu")
    run = run_of(tmp_path / "unit.fmu", tmp_path)
    run.set(run.place["tension"], [3.0] * len(run.get(run.place["tension"])))
    saved = run.snapshot()
    before = saved.values.copy()
    assert run.step(0.0, 0.01) == ""
    assert saved.values.tobytes() == before.tobytes()
    assert run.get(run.place["excursion"]) != before[run.place["excursion"]].tolist()


def test_a_hood_with_a_memory_says_that_it_writes_no_state(tmp_path):
    rubbing = [*SHELL, 'hood.contact.penetration="1 um"', "hood.contact.friction=0.1"]
    write_fmu(load_case("isometric_edc", rubbing), "hood", 2, tmp_path / "unit.fmu")
    with zipfile.ZipFile(tmp_path / "unit.fmu") as archive:
        description = archive.read("modelDescription.xml")
    assert b'canSerializeFMUstate="false"' in description
    assert b'canGetAndSetFMUstate="true"' in description
    assert Snapshot("", 0.0, np.zeros(3), None, None).to_bytes() == b""


def test_units_say_what_they_can(tmp_path):
    for fmi in (2, 3):
        write_fmu(STILL, "hood", fmi, tmp_path / "unit.fmu")
        assert Unit(tmp_path / "unit.fmu").opened.serialises


class FirstWordStopper:
    """Progress that interrupts a motion in its first word, as Ctrl-C does."""

    def __call__(self, text: str) -> None:
        if text.startswith("t = "):
            raise KeyboardInterrupt


LONG = 'forward={duration="0.08 s",must_rest=false,checkpoint=20}'


def units_case(tmp_path: Path, fmi: int, scheme: str) -> Case:
    from cosim.models.motion import moving_models

    case = moving_case()
    assert case.forward is not None
    models = moving_models(case, case.forward)
    paths = {part: tmp_path / f"{part}.fmu" for part in ("hood", "finger")}
    for part, path in paths.items():
        write_fmu(case, part, fmi, path)
    return load_case("pulley_edc", [*MOTION_OF_UNITS, LONG, *in_units(models, paths, scheme)])


@pytest.mark.parametrize(
    ("fmi", "scheme"),
    [
        (3, "linear"),
        *(pytest.param(2, s, marks=pytest.mark.slow) for s in ("explicit", "implicit")),
    ],
)
def test_a_motion_of_units_that_was_cut_off_goes_on_to_the_same_bytes(tmp_path, fmi, scheme):
    case = units_case(tmp_path, fmi, scheme)
    whole = run_case(case)
    with pytest.raises(StoppedError, match="Go on with: cosim run --resume"):
        run_case(case, Session(checkpoints=tmp_path), FirstWordStopper())
    assert identical(whole, run_case(case, Session(checkpoints=tmp_path)))


def test_a_unit_that_writes_no_state_has_no_checkpoints(tmp_path):
    case = units_case(tmp_path, 2, "explicit")
    old, new = 'canSerializeFMUstate="true"', 'canSerializeFMUstate="false"'
    path = change_description(tmp_path / "finger.fmu", tmp_path / "mute.fmu", old, new)
    mute = case.model_copy(update={"finger": case.finger.model_copy(update={"path": path})})
    with pytest.raises(InputError, match=r"mute\.fmu.*leave forward\.checkpoint out"):
        run_case(mute, Session(checkpoints=tmp_path))
