"""Fingers in motion in FMUs: the native motion by every scheme, and units that lack things."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import ConvergenceError, InputError
from cosim.fmu.finger import FmuMovingFinger
from cosim.fmu.unit import Unit
from cosim.fmu_export.run import part_of
from cosim.fmu_export.write import write_fmu
from cosim.models.motion import MovingModels, moving_models
from cosim.pipeline import run_case
from cosim.port import AffineLoad, Motion
from cosim.results.conventions import vector_of
from cosim.results.result import Result
from tests.helpers.fmus import (
    FREE,
    NEEDS_FMU,
    RAMP,
    SHORT,
    change_description,
    moving_case,
    places_of,
    run_in_fmpy,
)
from tests.proofs.coupling.fmu_rows import MOTION_OF_UNITS, in_units

pytestmark = NEEDS_FMU
BOTH = pytest.mark.parametrize("fmi", [2, 3])
UNITS = (*MOTION_OF_UNITS, SHORT, RAMP)


@pytest.fixture(scope="module")
def models() -> MovingModels:
    case = moving_case()
    assert case.forward is not None
    return moving_models(case, case.forward)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> dict[tuple[str, int], Path]:
    folder = tmp_path_factory.mktemp("moving")
    parts = ("hood", "finger", "coupled")
    paths = {(part, fmi): folder / f"{part}{fmi}.fmu" for part in parts for fmi in (2, 3)}
    for (part, fmi), path in paths.items():
        write_fmu(moving_case(), part, fmi, path)
    return paths


def ran(models: MovingModels, paths: dict[str, Path], scheme: str, *more: str) -> Result:
    own = UNITS if "finger" in paths else FREE
    units = in_units(models, paths, scheme)[1:]  # less its tolerance
    settings = [*own, *units, f'coupling={{scheme="{scheme}"}}', *more]
    return run_case(load_case("pulley_edc", settings))


@cache
def native(scheme: str, *more: str) -> Result:
    return run_case(moving_case(f'coupling={{scheme="{scheme}"}}', *more))


@pytest.mark.parametrize("parts", [("finger",), ("finger", "hood")], ids="+".join)
@pytest.mark.parametrize(
    ("scheme", "fmi"),
    [
        *(("explicit", 2), ("jacobi", 3), ("implicit", 2), ("newton", 3), ("linear", 2)),
        *(pytest.param(scheme, 3, marks=pytest.mark.slow) for scheme in ("explicit", "implicit")),
    ],
)
def test_every_scheme_makes_the_native_motion(written, models, fmi, parts, scheme):
    found = ran(models, {part: written[part, fmi] for part in parts}, scheme)
    own = native(scheme)
    assert np.ptp(own.data.angle.values, axis=0).max() > 1e-3
    for name in own.data.data_vars:
        if not (name == "excursion" and "hood" in parts):  # which counts from its own rest
            gap = np.abs(found.data[name].values - own.data[name].values)
            assert gap.max() < 1e-9, name
    for source, value in found.summary["energy_mJ"].items():
        assert energy(own)[source] == pytest.approx(value, abs=1e-9), source
    for name, value in found.summary["audit"].items():
        assert own.summary["audit"][name] == pytest.approx(value, abs=1e-9), name
    assert found.summary["fingertip_device"] == "fmu"


def energy(run: Result) -> dict[str, float]:
    """mJ, with the parts of the finger's as one, as a unit tells it."""
    told = run.summary["energy_mJ"]
    gained = told["kinetic"] + told["joints_stored"] + told["device_stored"] - told["gravity"]
    return {**told, "finger": told.get("finger", gained)}


def test_a_hood_in_an_fmu_alone(written, models):
    found, own = ran(models, {"hood": written["hood", 2]}, "newton"), native("newton")
    assert np.abs(found.data.angle - own.data.angle).max() < 1e-9
    assert "not_in_ledger" not in found.summary


@BOTH
def test_a_held_fingertip_pushes_as_the_native_one(tmp_path, models, fmi):
    held = 'finger.tip={kind="point"}'
    write_fmu(moving_case(held), "finger", fmi, tmp_path / "held.fmu")
    found, own = ran(models, {"finger": tmp_path / "held.fmu"}, "linear"), native("linear", held)
    assert np.linalg.norm(vector_of(own.summary["fingertip_force_N"])) > 0.01
    assert np.array_equal(found.data.tip_force, own.data.tip_force)

    def rows(result: Result) -> dict[tuple[str, str, str], np.ndarray]:
        return {(r.state, r.body, r.source): np.r_[r.force, r.moment] for r in result.rows}

    ours, other = rows(found), rows(own)
    told = {k for k in other if k[2].startswith("hood") or k[2] == "fingertip"}
    assert set(ours) == told
    for key in told:
        assert ours[key] == pytest.approx(other[key], abs=1e-9)
    assert "joints" in found.summary["not_in_ledger"]


def test_fibres_pull_on_a_unit_by_its_paths(written, models):
    fibre = (
        'tendons.FDP={activation=0.1,muscle={kind="millard",optimal_fibre_length="75 mm",'
        'tendon_slack_length="268.12 mm"}}'
    )
    found = ran(models, {"finger": written["finger", 2]}, "linear", fibre)
    own = native("linear", fibre)
    assert np.ptp(own.data.own_tension.sel(muscle="FDP").values) > 1e-4
    assert np.abs(found.data.own_tension - own.data.own_tension).max() < 1e-9


@BOTH
def test_finger_and_hood_in_one_unit_follow_the_tensions(written, models, fmi):
    own = native("linear").data
    unit = Unit(written["coupled", fmi])
    place = places_of(unit, moving_case(), "coupled")
    pulls = np.hstack([own.tension.values, own.own_tension.values])
    assert np.array_equal(unit.get(place["tension"]), pulls[0])
    for k in range(1, len(own.time)):
        unit.set(place["tension"], pulls[k])
        unit.step(1e-3)
        for name, values in (
            ("angle", own.angle),
            ("rate", own.rate),
            ("energy", own.finger_energy),
        ):
            assert unit.get(place[name]) == pytest.approx(values.values[k], abs=1e-12)
        assert unit.get(place["excursion"]) == pytest.approx(own.excursion.values[k], abs=1e-12)
        assert float(unit.get(place["residual"])) == pytest.approx(float(own.residual[k]), abs=1e-9)


@pytest.mark.parametrize("part", ["finger", "coupled"])
@BOTH
def test_a_motion_is_taken_back_to_the_bit(written, fmi, part):
    unit = Unit(written[part, fmi])
    place = places_of(unit, moving_case(), part)
    unit.step(0.003)
    before = unit.save()

    def on(factor: float) -> list[np.ndarray]:
        unit.restore(before)
        unit.set(place["tension"], factor * np.ones(place["tension"].shape))
        for _ in range(3):
            unit.step(0.002)
        return [unit.get(place[name]) for name in ("angle", "rate", "energy", "position")]

    first, other, again = on(1.0), on(3.0), on(1.0)
    assert not np.array_equal(first[0], other[0])
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


@pytest.mark.parametrize("part", ["finger", "coupled"])
def test_a_masters_step_is_cut_into_the_cases_own(written, part):
    ends = []
    for steps in ([0.004], [0.001] * 4, [0.002, 0.002], [0.0025, 0.0015]):
        unit = Unit(written[part, 2])
        place = places_of(unit, moving_case(), part)
        unit.set(place["tension"], np.ones(place["tension"].shape))
        for dt in steps:
            unit.step(dt)
        ends.append(unit.get(place["angle"]))
    for end in ends[1:3]:
        assert end == pytest.approx(ends[0], abs=1e-12)
    assert np.abs(ends[3] - ends[0]).max() > 1e-9  # of five steps


@pytest.mark.parametrize(
    ("fmi", "part"),
    [
        *((2, "coupled"), (3, "coupled"), (3, "finger")),
        pytest.param(2, "finger", marks=pytest.mark.slow),  # whose 1000 names FMPy parses slowly
    ],
)
def test_fmpy_finds_no_problem_and_runs_it(written, fmi, part):
    run_in_fmpy(written[part, fmi], 0.1)


def test_a_split_finger_in_its_cage(tmp_path):
    case, path = load_case("forward_fdp"), tmp_path / "caged.fmu"
    write_fmu(case, "finger", 3, path)
    unit = Unit(path)
    place = places_of(unit, case, "finger")
    unit.set(place["tension"], 2.0 * np.ones(place["tension"].shape))
    for _ in range(20):
        unit.step(0.01)
    assert np.linalg.norm(unit.get(place["tip_force"])) > 0.1
    assert float(unit.get(place["energy"])) > 0
    write_fmu(case, "coupled", 2, tmp_path / "coupled.fmu")
    whole = Unit(tmp_path / "coupled.fmu")
    there = places_of(whole, case, "coupled")
    whole.set(there["tension"], 2.0 * np.ones(there["tension"].shape))
    for _ in range(20):
        whole.step(0.01)
    assert whole.get(there["angle"]) == pytest.approx(unit.get(place["angle"]), abs=1e-9)


def without_rollback(path: Path, folder: Path) -> Path:
    old, new = 'canGetAndSetFMUstate="true"', 'canGetAndSetFMUstate="false"'
    return change_description(path, folder / "onward.fmu", old, new)


def test_a_unit_that_cannot_go_back_runs_staggered_and_else_says_so(written, models, tmp_path):
    path = without_rollback(written["finger", 2], tmp_path)
    found, own = ran(models, {"finger": path}, "explicit"), native("explicit")
    assert np.array_equal(found.data.angle, own.data.angle)
    for scheme in ("linear", "implicit"):
        with pytest.raises(InputError, match=r"canGetAndSetFMUstate.* explicit"):
            ran(models, {"finger": path}, scheme)


def test_a_hood_that_cannot_go_back_says_so_where_steps_are_repeated(written, models, tmp_path):
    path = without_rollback(written["hood", 2], tmp_path)
    paths = {"finger": written["finger", 2], "hood": path}
    found, own = ran(models, paths, "explicit"), native("explicit")
    assert np.array_equal(found.data.angle, own.data.angle)
    with pytest.raises(InputError, match="a step had to be repeated"):
        ran(models, paths, "implicit")


def test_a_unit_that_takes_held_loads_only(models, tmp_path):
    write_fmu(moving_case(), "finger", 2, tmp_path / "held.fmu", tangent=False)
    found, own = ran(models, {"finger": tmp_path / "held.fmu"}, "implicit"), native("implicit")
    assert np.abs(found.data.angle - own.data.angle).max() < 1e-9
    with pytest.raises(InputError, match="takes loads that are held over a step"):
        ran(models, {"finger": tmp_path / "held.fmu"}, "linear")


@BOTH
def test_it_answers_a_load_that_follows_as_the_native_finger_does(written, models, fmi):
    f, rng = models.finger, np.random.default_rng(1)
    unit = FmuMovingFinger(written["finger", fmi], f.bodies, f.joints, f.tendons)
    start, pulls = f.begin(models.posture), np.array([0.5, 0.2, 0.0, 0.3])
    at = f.motion(f.angles(start)).displace(1e-3 * rng.standard_normal((4, 6)))
    load = AffineLoad(at, 0.1 * rng.standard_normal((4, 6)), rng.standard_normal((24, 24)))
    for dt in (1e-3, 5e-4):
        now, there = unit.step(unit.begin({}), load, pulls, dt), f.step(start, load, pulls, dt)
        assert np.array_equal(unit.angles(now), f.angles(there))
        assert np.array_equal(unit.rates(now), f.rates(there))
        assert unit.energy(now) == f.energy(there)
        assert unit.dissipation(now) == f.dissipation(there)
        assert np.array_equal(unit.tip_wrench(now), f.tip_wrench(there))
        q = f.angles(there)
        assert np.array_equal(unit.path_lengths(q), f.path_lengths(q))
        assert np.array_equal(unit.tip(q), f.tip(q))
        assert unit.jacobian(q) == pytest.approx(f.jacobian(q), abs=1e-9)


def test_what_a_moving_unit_must_not_be_given(written, models):
    f = models.finger
    unit = FmuMovingFinger(written["finger", 2], f.bodies, f.joints, f.tendons)
    with pytest.raises(InputError, match="a posture of its own"):
        unit.begin({"MCP": 0.1})
    at = unit.motion(np.zeros(4))
    other = Motion(at.bodies[::-1], at.position, at.rotation)
    none = np.zeros((4, 6))
    with pytest.raises(InputError, match="load on bodies"):
        unit.step(unit.begin({}), AffineLoad(other, none, np.zeros((24, 24))), np.zeros(4), 1e-3)
    far = AffineLoad(at, none + np.inf, np.zeros((24, 24)))
    with pytest.raises(ConvergenceError, match="force, moment: holds a value that is not finite"):
        unit.step(unit.begin({}), far, np.zeros(4), 1e-3)
    assert unit.step(unit.begin({}), AffineLoad(at, none, np.zeros((24, 24))), np.zeros(4), 1e-3)


def test_a_static_finger_is_no_finger_in_motion(models, tmp_path):
    write_fmu(load_case("pulley_edc"), "finger", 2, tmp_path / "static.fmu")
    with pytest.raises(InputError, match=r"rate: the FMU has no variable rate\.MCP"):
        ran(models, {"finger": tmp_path / "static.fmu"}, "linear")


@pytest.mark.parametrize("settings", [(), FREE], ids=["still", "moving"])
def test_to_ask_for_poses_moves_nothing(settings: tuple[str, ...]):
    part = part_of(load_case("pulley_edc", settings), "finger")
    force = np.zeros((4, 3))
    force[3, 2] = 0.1
    state, before = part.step(part.start(), {**part.begin, "force": force}, 1e-3)
    asked = {**part.begin, "kinematics": np.array(1.0), "asked_angle": np.full(4, 0.3)}
    after, told = part.step(state, asked, 1e-3)
    assert after is state
    assert set(told) == {"position", "rotation", "tip", "path"}
    assert not np.array_equal(told["position"], before["position"])


def test_parts_begin_at_the_first_tensions():
    for part, split in (("finger", 4), ("coupled", 0)):
        begin = part_of(moving_case(), part).begin["tension"]
        stated = np.full(8, 0.05)
        stated[0] = 0.02 * 0.1 * 34.69
        assert begin == pytest.approx(stated[split:])
