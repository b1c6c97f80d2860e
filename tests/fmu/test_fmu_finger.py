"""A case whose finger is an FMU, at rest: the native equilibrium, other names, what it lacks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.case.file import json_schema, load_case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.fingers.kinds import unit
from cosim.fmu.finger import FmuFinger
from cosim.fmu.kinematics import MOST_KEPT
from cosim.fmu_export.write import write_fmu
from cosim.models.build import Models, build
from cosim.models.fit import check_fit
from cosim.pipeline import run_case
from cosim.results.result import Result
from tests.helpers.fmus import NEEDS_FMU, change_description
from tests.proofs.coupling.fmu_rows import in_units

pytestmark = NEEDS_FMU
BOTH = pytest.mark.parametrize("fmi", [2, 3])
CASE = load_case("pulley_edc", ["output.picture=false"])


@pytest.fixture(scope="module")
def models() -> Models:
    return build(CASE)


@pytest.fixture(scope="module")
def native() -> Result:
    return run_case(CASE)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> dict[tuple[str, int], Path]:
    folder = tmp_path_factory.mktemp("units")
    paths = {
        (part, fmi): folder / f"{part}{fmi}.fmu" for part in ("hood", "finger") for fmi in (2, 3)
    }
    for (part, fmi), path in paths.items():
        write_fmu(CASE, part, fmi, path)
    return paths


def ran(models: Models, paths: dict[str, Path], scheme: str = "newton", *more: str) -> Result:
    settings = ["output.picture=false", *in_units(models, paths, scheme), *more]
    return run_case(load_case("pulley_edc", settings))


def difference(a: Result, b: Result, key: str) -> float:
    return max(abs(a.summary[key][part] - value) for part, value in b.summary[key].items())


@pytest.mark.parametrize("scheme", ["newton", "implicit"])
@pytest.mark.parametrize("parts", [("finger",), ("finger", "hood")], ids="+".join)
@BOTH
def test_a_finger_in_an_fmu_gives_the_native_run(written, models, native, fmi, parts, scheme):
    found = ran(models, {part: written[part, fmi] for part in parts}, scheme)
    assert difference(found, native, "fingertip_force_N") < 1e-9
    assert difference(found, native, "fingertip_force_in_phalanx_N") < 1e-9
    for name in ("angle", "position", "hood_force", "tension", "own_tension", "tip_force"):
        ours, other = found.data[name].values, native.data[name].values
        assert np.abs(ours - other).max() < 1e-9, name
    excursion = [r.data.excursion.values for r in (found, native)]
    if "hood" in parts:  # which counts from where its own finger stood
        excursion = [e - e[0] for e in excursion]
    assert np.abs(excursion[0] - excursion[1]).max() < 1e-9
    for tendon, arm in native.summary["moment_arm_mm"].items():
        if tendon in models.hood.tendons:
            assert found.summary["moment_arm_mm"][tendon] == pytest.approx(arm, abs=1e-6)
    assert found.summary["audit_missed"] == []


def test_the_schemes_are_taken_at_their_word(written, models, monkeypatch):
    """A fixed point asks for no derivative but the last one, Newton's method for one each round."""
    asked = []
    own = type(models.hood).jacobian
    monkeypatch.setattr(
        type(models.hood), "jacobian", lambda self, state: asked.append(1) or own(self, state)
    )
    rounds = {}
    for scheme in ("newton", "implicit"):
        asked.clear()
        found = ran(models, {"finger": written["finger", 2]}, scheme)
        rounds[scheme] = found.summary["iterations"]["coupling"], len(asked)
    assert rounds["newton"][0] < rounds["implicit"][0]
    assert rounds["newton"][1] > 2
    assert rounds["implicit"][1] == 2


def test_the_ledger_holds_what_is_told_and_says_what_is_not(written, models, native):
    found = ran(models, {"finger": written["finger", 3]})
    assert "joints" in found.summary["not_in_ledger"]

    def rows(result: Result) -> dict[tuple[str, str, str], Any]:
        return {(r.state, r.body, r.source): np.r_[r.force, r.moment] for r in result.rows}

    ours, other = rows(found), rows(native)
    told = {k for k in other if k[2].startswith("hood") or k[2] == "fingertip"}
    told = {k for k in told if k[1] == "distal" or k[2] != "fingertip"}
    assert set(ours) == told
    for key in told:
        assert ours[key] == pytest.approx(other[key], abs=1e-9)


def test_other_names_are_mapped(written, models, native, tmp_path):
    path = change_description(
        written["finger", 2], tmp_path / "named.fmu", 'name="angle.', 'name="q_'
    )
    with pytest.raises(InputError, match=r"no variable angle\.MCP.*did you mean"):
        ran(models, {"finger": path})
    found = ran(models, {"finger": path}, "newton", 'finger.map.angle="q_{joint}"')
    assert difference(found, native, "fingertip_force_N") < 1e-9


def test_a_unit_that_tells_no_other_poses_can_be_met_by_newton_alone(
    written, models, native, tmp_path
):
    path = change_description(
        written["finger", 3], tmp_path / "plain.fmu", 'name="kinematics"', 'name="other"'
    )
    found = ran(models, {"finger": path})
    assert difference(found, native, "fingertip_force_N") < 1e-9
    assert "moment_arm_mm" not in found.summary
    with pytest.raises(InputError, match="gives no poses at joint angles"):
        ran(models, {"finger": path}, "implicit")


def test_a_unit_that_cannot_go_back_too(written, models, native, tmp_path):
    old, new = 'canGetAndSetFMUstate="true"', 'canGetAndSetFMUstate="false"'
    path = change_description(written["finger", 2], tmp_path / "onward.fmu", old, new)
    found = ran(models, {"finger": path})
    assert difference(found, native, "fingertip_force_N") < 1e-9
    with pytest.raises(InputError, match="canGetAndSetFMUstate"):
        ran(models, {"finger": path}, "implicit")


@BOTH
def test_a_unit_that_takes_held_loads_only_is_met_by_a_fixed_point(models, native, tmp_path, fmi):
    path = tmp_path / "held.fmu"
    write_fmu(CASE, "finger", fmi, path, tangent=False)
    found = ran(models, {"finger": path}, "implicit")
    assert difference(found, native, "fingertip_force_N") < 1e-9
    with pytest.raises(InputError, match=r'constant loads only.*coupling\.scheme = "implicit"'):
        ran(models, {"finger": path}, "newton")


@BOTH
def test_poses_at_any_angles_are_the_native_ones(written, models, fmi):
    f = models.finger
    finger = FmuFinger(written["finger", fmi], f.bodies, f.joints, f.tendons)
    before = finger.unit.get(finger._place["angle"])
    angles = np.array([0.3, 0.05, 0.9, 0.2])
    pose, state = finger.kinematics.at(angles), f.start(dict(zip(f.joints, angles, strict=True)))
    assert np.abs(pose.motion.twist_to(f.motion(state))).max() < 1e-12
    assert pose.tip == pytest.approx(f.tip(state), abs=1e-14)
    assert pose.path == pytest.approx(f.path_lengths(state), abs=1e-14)
    slope = finger.kinematics.jacobian(angles)
    assert slope == pytest.approx(f.jacobian(state), abs=1e-9)
    finger.unit.restore(finger.start({}).saved)
    assert np.array_equal(finger.unit.get(finger._place["angle"]), before)


def test_poses_are_asked_for_once_and_not_kept_for_ever(written, models, monkeypatch):
    f = models.finger
    finger = FmuFinger(written["finger", 2], f.bodies, f.joints, f.tendons)
    steps, own = [], type(finger.unit).step_from
    monkeypatch.setattr(
        type(finger.unit),
        "step_from",
        lambda self, *args, **more: steps.append(1) or own(self, *args, **more),
    )
    for angle in (0.1, 0.2, 0.1):
        finger.kinematics.at(np.full(4, angle))
    assert len(steps) == 2
    for angle in np.linspace(0.3, 0.6, MOST_KEPT):
        finger.kinematics.at(np.full(4, angle))
    assert len(finger.kinematics._kept) == MOST_KEPT


def test_the_command_runs_it_from_a_file_beside(written, models, tmp_path, monkeypatch):
    path = tmp_path / "mine" / "finger.fmu"
    path.parent.mkdir()
    path.write_bytes(written["finger", 2].read_bytes())
    joints, tendons = list(models.finger.joints), list(models.finger.tendons)
    case = tmp_path / "mine" / "unit.toml"
    case.write_text(
        'extends = "pulley_edc"\ntitle = "a finger in a unit"\n[finger]\nkind = "fmu"\n'
        f'path = "finger.fmu"\njoints = {joints}\ntendons = {tendons}\n'
    )
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(app, ["check", str(case)]).exit_code == 0
    done = CliRunner().invoke(app, ["run", str(case), "--out", str(tmp_path / "runs")])
    assert done.exit_code == 0, done.output
    assert "fingertip force, magnitude, N" in done.stdout
    files = {p.name for p in (tmp_path / "runs" / "unit").iterdir()}
    assert {"summary.json", "results.nc", "ledger.csv", "picture.png", "case.toml"} <= files


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ('coupling={scheme="one_way"}', r'one pass .* does not go with finger\.kind = "fmu"'),
        ('tendons.EDC={excursion="1 mm"}', r"tendons\.EDC: .* neither muscle nor excursion"),
        ('hood={kind="split"}', 'does not go with finger.kind = "fmu"'),
        ('finger.joints=["MCP","MCP"]', "joints: names one twice"),
        ('finger.map={torque="t"}', "unknown quantity"),
        ('finger.tendons=["EDC"]', "counted twice"),
        ('tendons.RI.tension="1 N"', r"tendons\.RI: .* no such tendon"),
        ('finger.path="nowhere.fmu"', "no such file"),
    ],
)
def test_what_does_not_go_with_it(written, models, setting, words):
    paths = {"finger": written["finger", 2]}
    with pytest.raises(InputError, match=words):
        check_fit(load_case("pulley_edc", [*in_units(models, paths, "newton"), setting]))


def test_it_is_run_and_nothing_else(written, models):
    case = load_case("pulley_edc", in_units(models, {"finger": written["finger", 2]}, "newton"))
    with pytest.raises(InputError, match="can only be run"):
        build(case)
    with pytest.raises(InputError, match='"index" is no FMU'):
        unit(CASE.finger)


def test_rounds_that_do_not_end_are_an_error(written, models):
    settings = ["solve.max_iterations=2"]
    with pytest.raises(ConvergenceError, match="2 rounds of the fixed point: a joint would"):
        ran(models, {"finger": written["finger", 2]}, "implicit", *settings)


def test_the_schema_knows_it():
    found = json_schema()["$defs"]["FmuFingerConfig"]["properties"]
    assert {"path", "joints", "bodies", "tendons", "map", "assume_si"} <= set(found)
    assert "kinematics" in str(found["map"])
