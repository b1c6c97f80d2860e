"""Cases as FMUs: valid, complete, the same numbers, and no exception over their border."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, equilibrium
from cosim.errors import ConvergenceError, InputError
from cosim.fmu.mapping import VariablePlace, places
from cosim.fmu.unit import Unit
from cosim.fmu_export.hooks import Stateful
from cosim.fmu_export.run import UnitRun, part_of
from cosim.fmu_export.state import SerialisedState
from cosim.fmu_export.static_parts import HoodPart
from cosim.fmu_export.write import write_fmu
from cosim.models.build import build, tensions
from cosim.port import STATIC, PairState, Tensions, rotation_matrix
from cosim.solve.solvers import solve
from tests.helpers.fmus import IN_PROCESS, NEEDS_FMU, InitialUnit, places_of, run_in_fmpy

pytestmark = NEEDS_FMU
PARTS = ("hood", "finger", "coupled")
BOTH = pytest.mark.parametrize("fmi", [2, 3])


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case("pulley_edc")


@pytest.fixture(scope="module")
def written(case, tmp_path_factory) -> dict[tuple[str, int], Path]:
    folder = tmp_path_factory.mktemp("written")
    paths = {(part, fmi): folder / f"{part}{fmi}.fmu" for part in PARTS for fmi in (2, 3)}
    for (part, fmi), path in paths.items():
        write_fmu(case, part, fmi, path)
    return paths


@BOTH
@pytest.mark.parametrize("part", PARTS)
def test_fmpy_finds_no_problem_and_runs_a_second(tmp_path, written, case, part, fmi):
    """Of FMI 2 without the tangent's hundreds of names, of which FMPy parses each."""
    path = written[part, fmi]
    if fmi == 2:
        path = tmp_path / "short.fmu"
        write_fmu(case, part, fmi, path, tangent=False)
    run_in_fmpy(path, 1.0)


def test_another_importer_gets_the_native_force(written, case):
    pytest.importorskip("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(step_size=100_000_000)
    slave = CosimLocalSlave(fmu_path=str(written["coupled", 2]), instance_name="finger")
    index = execution.add_local_slave(local_slave=slave)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer=observer)
    assert execution.simulate_until(target_time=1_000_000_000)
    variables = execution.slave_variables(slave_index=index)
    names = {v.name.decode(): v.reference for v in variables}
    refs = [names[f"tip_force.{axis}"] for axis in "xyz"]
    force = observer.last_real_values(slave_index=index, variable_references=refs)
    native = solve(case)[1].loaded.balance.tip_force
    assert force == pytest.approx(native, abs=1e-9)


@BOTH
def test_the_hood_answers_the_same_bits(written, case, fmi):
    models = build(case)
    unit = Unit(written["hood", fmi])
    place = places_of(unit, case, "hood")
    motion = models.finger.motion(models.finger.start({"PIP": 0.7}))
    tension = np.array([1.0, 0.2, 3.0, 0.4])
    native = models.hood.advance(models.hood.start(motion), motion, tension, STATIC)
    given = {"position": motion.position, "rotation": motion.rotation, "tension": tension}
    for name, value in given.items():
        unit.set(place[name], value)
    unit.set(place["with_tangent"], 1.0)
    unit.step(0.01)
    wrench = np.concatenate([unit.get(place["force"]), unit.get(place["moment"])], axis=2)
    pull = np.hstack([unit.get(place["pull_force"]), unit.get(place["pull_moment"])])
    assert np.array_equal(wrench, native.load.wrench)
    assert np.array_equal(pull, native.load.pull)
    assert np.array_equal(unit.get(place["excursion"]), native.excursion)
    for name, value in vars(models.hood.jacobian(native.state)).items():
        assert np.array_equal(unit.get(place[name]).ravel(), value.ravel()), name


@BOTH
def test_the_coupled_finger_follows_its_tensions_and_is_taken_back(written, case, fmi):
    models = build(case)
    unit = Unit(written["coupled", fmi])
    place = places_of(unit, case, "coupled")
    pulls = np.concatenate(tensions(case, models))
    unit.step(0.01)
    before, first = unit.save(), unit.get(place["tip_force"])
    unit.set(place["tension"], 1.5 * pulls)
    unit.step(0.01)
    more = unit.get(place["tip_force"])
    assert np.linalg.norm(more) > 1.2 * np.linalg.norm(first)
    unit.restore(before)
    assert np.array_equal(unit.get(place["tip_force"]), first)
    unit.set(place["tension"], 2.0 * pulls)
    unit.restore(before)  # inputs belong to a state
    assert np.array_equal(unit.get(place["tension"]), pulls)
    unit.set(place["tension"], 1.5 * pulls)
    unit.step(0.01)
    assert np.array_equal(unit.get(place["tip_force"]), more)


def test_excursions_count_from_rest(written, case):
    unit = Unit(written["coupled", 2])
    place = places_of(unit, case, "coupled")
    rest = np.full(place["tension"].shape, case.solve.resting_tension)
    unit.set(place["tension"], rest)
    unit.step(0.01)
    assert np.abs(unit.get(place["excursion"])).max() < 1e-7
    unit.set(place["tension"], rest + np.eye(len(rest))[0])
    unit.step(0.01)
    assert unit.get(place["excursion"])[0] > 1e-6


@pytest.mark.parametrize("name", ["planar_edc", "split_edc"])
def test_other_fingers_and_hoods(tmp_path, name):
    case, path = load_case(name), tmp_path / "coupled.fmu"
    write_fmu(case, "coupled", 3, path)
    unit = Unit(path)
    unit.step(0.01)
    force = unit.get(places_of(unit, case, "coupled")["tip_force"])
    native = solve(case)[1].loaded.balance.tip_force
    assert force == pytest.approx(native, abs=1e-9)


def test_a_hood_without_tendons_is_refused(tmp_path):
    with pytest.raises(InputError, match="part of the finger's own tendons"):
        write_fmu(load_case("split_edc"), "hood", 2, tmp_path / "hood.fmu")
    assert not list(tmp_path.iterdir())


def test_the_archive_holds_the_files_that_the_case_names(tmp_path):
    import trimesh

    bone = tmp_path / "mine" / "bone.stl"
    bone.parent.mkdir()
    trimesh.creation.capsule(height=15.0, radius=4.0).export(bone)
    text = bone.read_bytes()
    table = f"{{ surface = {json.dumps(str(bone))}, unit = 'mm', frame = 'ours' }}"
    case = load_case("pulley_edc", [f"finger.bones.distal={table}"])
    write_fmu(case, "hood", 2, tmp_path / "hood.fmu")
    write_fmu(case, "hood", 2, tmp_path / "again.fmu")
    assert (tmp_path / "hood.fmu").read_bytes() == (tmp_path / "again.fmu").read_bytes()
    bone.unlink()
    with zipfile.ZipFile(tmp_path / "hood.fmu") as archive:
        assert archive.read("resources/file_0.stl") == text
        assert b"generationDateAndTime" not in archive.read("modelDescription.xml")
        assert not any(str(tmp_path).encode() in archive.read(n) for n in archive.namelist())
    Unit(tmp_path / "hood.fmu").step(0.01)


@BOTH
@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("tension", np.full(4, np.nan), "tension: holds a value that is not finite"),
        ("rotation", np.ones((4, 3, 3)), "no rotation matrix"),
        ("rotation", np.tile(np.diag([1.0, 1, -1]), (4, 1, 1)), "no rotation matrix"),
    ],
)
def test_a_bad_input_fails_the_step_with_a_message_and_changes_nothing(
    written, case, fmi, name, value, words
):
    unit = Unit(written["hood", fmi])
    place = places_of(unit, case, "hood")
    unit.step(0.01)
    good = unit.save()
    force = unit.get(place["force"])
    unit.set(place[name], value)
    with pytest.raises(ConvergenceError, match=words):
        unit.step(0.01)
    unit.restore(good)
    unit.step(0.01)
    assert np.array_equal(unit.get(place["force"]), force)


class Panic(BaseException):
    """As the panic of a compiled library: no Exception."""


@BOTH
@pytest.mark.parametrize("fault", [ZeroDivisionError, Panic, SystemExit])
def test_no_fault_of_the_program_crosses_the_border(written, monkeypatch, fmi, fault):
    unit = Unit(written["hood", fmi], IN_PROCESS)

    def broken(*_: object) -> None:
        raise fault("by nought")

    monkeypatch.setattr(HoodPart, "step", broken)
    with pytest.raises(ConvergenceError, match=f"{fault.__name__}: by nought"):
        unit.step(0.01)
    monkeypatch.undo()
    unit.step(0.01)


class Odd:
    """A value at which every use panics."""

    def __getattr__(self, name: str) -> None:
        raise Panic(name)

    def __iter__(self) -> None:
        raise Panic("iteration")


def test_no_call_of_a_unit_raises_but_the_user_s_own_stop(written, tmp_path, monkeypatch):
    with zipfile.ZipFile(written["hood", 2]) as archive:
        archive.extractall(tmp_path)
    run = UnitRun(tmp_path / "resources")
    good = run.snapshot()
    assert np.isnan(run.get([Odd()])).all()
    assert "does not exist" in run.step(0.0, 0.01)
    run.restore(good)
    run.set([0], Odd())
    assert "was set that does not exist" in run.step(0.0, 0.01)
    run.restore(SerialisedState(Odd()))
    assert "none of this unit's" in run.step(0.0, 0.01)
    assert Stateful._fmu_state_to_bytes(replace(good, values=Odd())) == b""
    run.restore(good)

    def broken(*_: object) -> None:
        raise Panic("in the middle")

    monkeypatch.setattr(HoodPart, "initial", broken)
    run.enter_initialization()
    assert np.isnan(run.get(run.place["force"])).all()
    assert "Panic: in the middle" in run.exit_initialization()

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(HoodPart, "step", stopped)
    with pytest.raises(KeyboardInterrupt):
        run.step(0.0, 0.01)


def step_in_threads(path: Path, case: Case, part: str) -> None:
    """A step in another thread than the unit was made in ends as one in its own."""
    unit = Unit(path)
    place = places_of(unit, case, part)
    unit.step(0.01)  # from its start, whose answer is known since its initialization
    unit.set(place["tension"], 1.5 * np.ones(place["tension"].shape))
    start, ends = unit.save(), []
    with ThreadPoolExecutor(1) as pool:
        for step in (unit.step, lambda dt: pool.submit(unit.step, dt).result()):
            unit.restore(start)
            step(0.01)
            ends.append([unit.get(place[name]) for name in OUTPUTS[part]])
    for own, other in zip(*ends, strict=True):
        assert np.array_equal(own, other)


@BOTH
@pytest.mark.parametrize("part", PARTS)
def test_a_unit_steps_in_another_thread_than_it_was_made_in(written, case, fmi, part):
    step_in_threads(written[part, fmi], case, part)


def test_a_unit_of_a_shell_steps_in_another_thread_than_it_was_made_in(tmp_path):
    """Its linear solver serves the thread alone that made it."""
    case = load_case("isometric_edc", ["hood.mesh.quads=120"])
    write_fmu(case, "hood", 3, tmp_path / "shell.fmu")
    step_in_threads(tmp_path / "shell.fmu", case, "hood")


OUTPUTS = {
    "hood": ("force", "moment", "pull_force", "excursion"),
    "finger": ("angle", "tip_force", "position"),
    "coupled": ("angle", "tip_force", "excursion"),
}


@BOTH
@pytest.mark.parametrize("part", PARTS)
def test_outputs_follow_from_the_inputs_at_initialization(written, case, fmi, part):
    """FMPy's own import: inputs are set in initialization mode, and no step jumps afterwards."""
    unit = InitialUnit(written[part, fmi])
    place = places_of(unit, case, part)
    unit.set(place["tension"], 2.0 + np.arange(place["tension"].size))
    within = [unit.get(place[name]) for name in OUTPUTS[part]]
    unit.set(place["tension"], 1.0 + np.arange(place["tension"].size))
    unit.leave_initialization()
    first = [unit.get(place[name]) for name in OUTPUTS[part]]
    assert not np.array_equal(within[1], first[1])
    unit.step(1e-9)
    for name, at_start in zip(OUTPUTS[part], first, strict=True):
        assert at_start.any(), name
        assert unit.get(place[name]) == pytest.approx(at_start, abs=1e-9), name


@BOTH
def test_inputs_without_an_answer_fail_the_initialization(written, case, fmi):
    unit = InitialUnit(written["hood", fmi])
    place = places_of(unit, case, "hood")
    unit.set(place["tension"], np.full(4, np.nan))
    with pytest.raises(InputError, match="tension: holds a value that is not finite"):
        unit.leave_initialization()


@BOTH
def test_a_variable_that_is_none_fails_the_next_step(written, fmi):
    unit = Unit(written["hood", fmi])
    good = unit.save()
    nowhere = VariablePlace((99_999,), (), False)
    unit.set(nowhere, 1.0)
    with pytest.raises(ConvergenceError, match="was set that does not exist"):
        unit.step(0.01)
    unit.restore(good)
    with pytest.raises(ConvergenceError, match="not finite"):
        unit.get(nowhere)
    with pytest.raises(ConvergenceError, match="was asked for that does not exist"):
        unit.step(0.01)


def test_a_loose_tolerance_reaches_the_hood(case, monkeypatch):
    part = part_of(case, "hood")
    asked = []
    monkeypatch.setattr(
        type(part.hood), "with_tolerance", lambda self, tolerance: asked.append(tolerance) or self
    )
    for tolerance in (0.0, 1e-3):
        part.step(None, {**part.begin, "tolerance": np.array(tolerance)}, 0.01)
    assert asked == [1e-3]


def test_time_steps_reach_the_hood_where_static_is_off(case, monkeypatch):
    part = part_of(case, "hood")
    steps, native = [], type(part.hood).advance
    monkeypatch.setattr(
        type(part.hood),
        "advance",
        lambda self, state, motion, tension, dt: (
            steps.append(dt) or native(self, state, motion, tension, dt)
        ),
    )
    for static in (0.0, 1.0):
        part.step(None, {**part.begin, "static": np.array(static)}, 0.01)
    assert steps == [0.01, STATIC]


def test_the_finger_balances_a_load_that_follows_it(written, case):
    """Against `equilibrium`, with the hood's load and tangent at its answer put in."""
    models = build(case)
    pulls = tensions(case, models)
    f, start = models.finger, models.finger.start(models.posture)
    options = CouplingOptions(case.solve.tolerance)
    before = models.hood.start(f.motion(start))
    native = equilibrium(models.pair, PairState(start, before), Tensions(*pulls), options)
    unit = Unit(written["finger", 2])
    place = places_of(unit, case, "finger")
    at_start = models.hood.advance(before, f.motion(start), pulls[0], STATIC)
    state, hood = unit.save(), at_start
    for _ in range(6):
        unit.restore(state)
        total = hood.load.total()
        unit.set(place["force"], total[:, :3])
        unit.set(place["moment"], total[:, 3:])
        unit.set(place["load_motion"], models.hood.jacobian(hood.state).load_motion)
        unit.step(0.01)
        state = unit.save()
        motion = type(native.motion)(
            f.bodies, unit.get(place["position"]), unit.get(place["rotation"])
        )
        hood = models.hood.advance(hood.state, motion, pulls[0], STATIC)
    assert unit.get(place["tip_force"]) == pytest.approx(native.balance.tip_force, abs=1e-9)
    assert unit.get(place["angle"]) == pytest.approx(f.angles(native.finger_state), abs=1e-9)


def test_a_rotation_within_rounding_is_taken(case):
    part = part_of(case, "hood")
    turn = part.begin["rotation"] @ rotation_matrix(np.array([0.1, 0.2, 0.3])) * (1 + 1e-8)
    part.step(None, {**part.begin, "rotation": turn}, 0.01)


def test_without_tangent_a_load_is_held(tmp_path, case):
    write_fmu(case, "finger", 2, tmp_path / "held.fmu", tangent=False)
    write_fmu(case, "finger", 2, tmp_path / "full.fmu")
    force = np.zeros((4, 3))
    force[3, 2] = 0.2
    ends = []
    for name in ("held", "full"):
        unit = Unit(tmp_path / f"{name}.fmu")
        names = {v.name for v in unit.opened.description.modelVariables}
        assert any(n.startswith("load_motion") for n in names) == (name == "full")
        quantities = part_of(case, "finger", tangent=name == "full").quantities
        place = places(unit.opened, quantities, {})
        unit.set(place["force"], force)
        unit.step(0.01)
        ends.append(unit.get(place["angle"]))
    assert np.array_equal(*ends)


@BOTH
def test_inputs_belong_to_a_state(written, case, fmi):
    unit = Unit(written["hood", fmi])
    place = places_of(unit, case, "hood")
    before, tension = unit.save(), unit.get(place["tension"])
    unit.set(place["tension"], tension + 1)
    after = unit.save()
    unit.restore(before)
    assert np.array_equal(unit.get(place["tension"]), tension)
    unit.restore(after)
    assert np.array_equal(unit.get(place["tension"]), tension + 1)


def test_a_unit_is_whole_that_is_written_after_another_was_loaded(written, tmp_path):
    code = (
        "import sys\nfrom pathlib import Path\nfrom cosim.case.file import load_case\n"
        "from cosim.fmu.unit import Unit\nfrom cosim.fmu_export.write import write_fmu\n"
        "folder, *units = map(Path, sys.argv[1:])\nfor fmi, unit in enumerate(units, 2):\n"
        "    Unit(unit).step(0.01)\n    out = folder / f'{fmi}.fmu'\n"
        "    write_fmu(load_case('pulley_edc'), 'hood', fmi, out)\n    Unit(out).step(0.01)\n"
    )
    units = [str(written["hood", fmi]) for fmi in (2, 3)]
    words = [sys.executable, "-c", code, str(tmp_path), *units]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for fmi in (2, 3):
        assert (tmp_path / f"{fmi}.fmu").read_bytes() == written["hood", fmi].read_bytes()
