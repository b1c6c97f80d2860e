"""Every muscle and actuator along a path is imported, whatever its kind; the reasons for what is
not are true."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
from typer.testing import CliRunner

from cosim.cli import app
from rigid.opensim.forces import OPENSIM
from tests.helpers.osim_files import TWO_POINTS, import_text, model, muscle, point, reasons

MUSCLES = (
    *("DeGrooteFregly2016Muscle", "Delp1990Muscle_Deprecated", "MeyerFregly2016Muscle"),
    *("Millard2012AccelerationMuscle", "Millard2012EquilibriumMuscle", "RigidTendonMuscle"),
    *("Schutte1993Muscle_Deprecated", "Thelen2003Muscle", "Thelen2003Muscle_Deprecated"),
)
"""Every concrete muscle that OpenSim 4.6 registers."""
ACTUATORS = ("PathActuator", "McKibbenActuator", "ClutchedPathSpring")
"""Its other actuators along a path."""
STRETCHED = ("Ligament", "Blankevoort1991Ligament", "PathSpring", "ExpressionBasedPathForce")
"""Its other forces along a path."""
PATHLESS = {
    "no joint or tendon of MuJoCo is this force": (
        *("BushingForce", "FunctionBasedBushingForce", "ExpressionBasedBushingForce"),
        *("ExpressionBasedCoordinateForce", "ExpressionBasedPointToPointForce", "ExternalForce"),
        *("PrescribedForce", "MeyerFregly2016Force"),
    ),
    "contact is not imported": (
        *("HuntCrossleyForce", "ElasticFoundationForce", "SmoothSphereHalfSpaceForce"),
        "ExponentialContactForce",
    ),
    "only actuators with a <GeometryPath>": (
        *("ActivationCoordinateActuator", "BodyActuator", "CoordinateActuator", "PointActuator"),
        *("PointToPointActuator", "TorqueActuator", "PathActuator", "McKibbenActuator"),
    ),
    "a muscle without a <GeometryPath>": MUSCLES,
    "not imported and not applied": ("PointToPointSpring",),
}


def force(kind: str, inside: str = "", path: str = '<GeometryPath name="path">{}</GeometryPath>'):
    points = f"<PathPointSet><objects>{TWO_POINTS}</objects></PathPointSet>"
    return (
        f'<{kind} name="x"><optimal_force>2</optimal_force>{path.format(points)}{inside}</{kind}>'
    )


@pytest.mark.parametrize("kind", [*MUSCLES, *ACTUATORS, "SomebodysMuscle_Plugin", "SomebodysPull"])
@pytest.mark.parametrize("path", ['<GeometryPath name="path">{}</GeometryPath>', "wrapped"])
def test_whatever_pulls_along_a_path_is_taken(tmp_path: Path, kind: str, path: str) -> None:
    if path == "wrapped":
        path = '<path><GeometryPath name="g">{}</GeometryPath></path>'
    made = import_text(tmp_path, model(forces=force(kind, "<stiffness>3</stiffness>", path)))
    own = OPENSIM if "Muscle" in kind else {}
    assert [loss.what for loss in made.losses] == ["changed"] * bool(own)
    assert all(key in loss.reason for key in own for loss in made.losses)
    assert made.muscles["x"].kind == kind
    assert made.muscles["x"].properties == {"optimal_force": 2.0, "stiffness": 3.0, **own}
    assert made.path_actuators == 1
    built = mujoco.MjModel.from_xml_string(made.xml)
    assert built.tendon_num[built.tendon("x").id] == 2
    assert built.actuator("x").trnid[0] == built.tendon("x").id


@pytest.mark.parametrize("kind", STRETCHED)
def test_what_only_its_stretch_makes_pull_is_told(tmp_path: Path, kind: str) -> None:
    made = import_text(tmp_path, model(forces=force(kind) + muscle("mus", TWO_POINTS)))
    assert list(made.muscles) == ["mus"]
    assert made.path_actuators == 1
    (loss,) = made.losses
    assert loss.reason == "its stretch alone makes it pull; the force is not applied"


@pytest.mark.parametrize("kind", [*MUSCLES, *ACTUATORS])
@pytest.mark.parametrize("path", ["FunctionBasedPath", "Scholz2015GeometryPath"])
def test_another_kind_of_path_is_told(tmp_path: Path, kind: str, path: str) -> None:
    made = import_text(tmp_path, model(forces=force(kind, path=f'<{path} name="path"/>')))
    assert made.muscles == {}
    assert made.path_actuators == 1
    assert reasons(made, kind).endswith(f"its path is a {path}; only a GeometryPath is imported")


@pytest.mark.parametrize(
    ("kind", "reason"), [(kind, reason) for reason, kinds in PATHLESS.items() for kind in kinds]
)
def test_a_force_without_a_path_is_told(tmp_path: Path, kind: str, reason: str) -> None:
    made = import_text(tmp_path, model(forces=force(kind, path="")))
    assert made.muscles == {}
    assert made.path_actuators == 0
    (loss,) = made.losses
    assert reason in loss.reason


def test_the_command_ends_with_code_2_where_no_muscle_is_imported(tmp_path: Path) -> None:
    moving = TWO_POINTS + point("c", "/bodyset/b", "2 1 0", "MovingPathPoint")
    bad, good = muscle("bad", moving), muscle("good", TWO_POINTS)
    for forces, code, told in ((bad, 2, "0 of 1 muscles"), (bad + good, 0, "1 of 2 muscles")):
        (tmp_path / "m.osim").write_text(model(forces=forces))
        words = ["import", f"{tmp_path}/m.osim", "-o", f"{tmp_path}/m.xml"]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == code
        assert told in result.output
        assert "path point 'c' moves along x by no function" in result.output
        assert (tmp_path / "m.losses.txt").exists()


@pytest.mark.opensim
def test_the_kinds_are_those_of_opensim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # opensim leaves a log where it is imported
    opensim = pytest.importorskip("opensim")
    names = opensim.ArrayStr()
    opensim.OpenSimObject.getRegisteredTypenames(names)
    found: dict[str, set[str]] = {"muscle": set(), "actuator": set(), "other": set()}
    for i in range(names.getSize()):
        made = opensim.OpenSimObject.newInstanceOfType(names.get(i))
        if opensim.Force.safeDownCast(made) is not None and made.hasProperty("path"):
            muscular = opensim.Muscle.safeDownCast(made) is not None
            pulls = opensim.PathActuator.safeDownCast(made) is not None
            found["muscle" if muscular else "actuator" if pulls else "other"].add(names.get(i))
    wanted = {"muscle": set(MUSCLES), "actuator": set(ACTUATORS), "other": set(STRETCHED)}
    assert found == wanted


@pytest.mark.opensim
@pytest.mark.parametrize("kind", [*MUSCLES, *ACTUATORS])
def test_a_kind_as_opensim_writes_it_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    opensim = pytest.importorskip("opensim")
    (tmp_path / "plain.osim").write_text(model())
    written = opensim.Model("plain.osim")
    made = opensim.PathActuator.safeDownCast(opensim.OpenSimObject.newInstanceOfType(kind))
    made.setName("x")
    if kind == "ClutchedPathSpring":  # its defaults are not valid
        spring = opensim.ClutchedPathSpring.safeDownCast(made)
        spring.setStiffness(1.0)
        spring.setDissipation(0.1)
    made.addNewPathPoint("a", written.getGround(), opensim.Vec3(-1, 1, 0))
    made.addNewPathPoint("b", written.getBodySet().get("b"), opensim.Vec3(1, 1, 0))
    written.addForce(made)
    written.finalizeConnections()
    written.printToXML("m.osim")
    read = import_text(tmp_path, (tmp_path / "m.osim").read_text())
    assert read.muscles["x"].kind == kind
    of_it = [loss for loss in read.losses if kind in loss.place and not loss.group]
    assert all("OpenSim's own" in loss.reason for loss in of_it)
    if (muscle := opensim.Muscle.safeDownCast(made)) is not None:
        stated = read.muscles["x"].properties
        assert stated["max_isometric_force"] == muscle.getMaxIsometricForce()
        assert stated["optimal_fiber_length"] == muscle.getOptimalFiberLength()
        assert stated["tendon_slack_length"] == muscle.getTendonSlackLength()
        assert (
            stated["pennation_angle_at_optimal"] == muscle.getPennationAngleAtOptimalFiberLength()
        )
