"""Functions of OpenSim, what follows a coordinate by one, parts that are left out, and points that
come and go."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cosim.errors import InputError
from rigid.opensim.components import components
from rigid.opensim.functions import quartic, read_function, straight
from rigid.opensim.losses import report
from rigid.opensim.osim import Imported, import_osim
from rigid.opensim.skeleton import OsimSkeleton, read_skeleton
from rigid.opensim.xml import read_xml
from tests.helpers.osim_files import (
    PIN,
    PLAIN,
    TWO_POINTS,
    axis,
    body,
    coordinate,
    custom,
    import_text,
    joint,
    model,
    muscle,
    point,
    reasons,
)

KNOTS = (
    "<x>-2.0944 -1.74533 -1.39626 -1.0472 -0.698132 -0.349066 -0.174533 0.197344 0.337395 "
    "0.490178 1.52146 2.0944</x><y>-0.0032 0.00179 0.00411 0.0041 0.00212 -0.001 -0.0031 "
    "-0.005227 -0.005435 -0.005574 -0.005435 -0.00525</y>"
)
"""Of a knee: how far the tibia slides (m) by its angle (rad)."""
AT = (-2.2, -1.2, -0.2, 0.4, 1.4, 2.4)
BY_OPENSIM = {
    "SimmSpline": (
        *(-0.005149973048547959, 0.004383123108905307, -0.0028174990233614207),
        *(-0.005498848678993552, -0.005498229224459147, -0.005254133588861085),
    ),
    "PiecewiseLinearFunction": (
        *(-0.004709565416678609, 0.004104377470921905, -0.0027935782917843646),
        *(-0.005491957220371376, -0.0054513708277658295, -0.0051513230006632466),
    ),
    "GCVSpline": (
        *(None, 0.004407022364337067, -0.002813882340536191),
        *(-0.0055006992321901165, -0.005488466798831646, None),
    ),
}
"""What OpenSim 4.6 answers at AT; None where its quintic goes on otherwise beyond the knots."""
RANGE = "<range>-1.5 0.5</range><default_value>-0.3</default_value>"
LINE = "<LinearFunction><coefficients>{} {}</coefficients></LinearFunction>"
SPLINE = f"<SimmSpline>{KNOTS}</SimmSpline>"


def function_of(folder: Path, text: str):
    path = folder / "f.osim"
    path.write_text(f'<OpenSimDocument Version="40000">{text}</OpenSimDocument>')
    return read_function(read_xml(path).children[0])


@pytest.mark.parametrize("kind", BY_OPENSIM)
def test_a_spline_is_opensim_s(kind: str, tmp_path: Path) -> None:
    curve = function_of(tmp_path, f"<{kind}>{KNOTS}</{kind}>")
    for at, value in zip(AT, BY_OPENSIM[kind], strict=True):
        if value is not None:
            assert curve(at) == pytest.approx(value, abs=1e-14)


@pytest.mark.parametrize(
    ("text", "at", "value"),
    [
        ("<Constant><value>3</value></Constant>", 7.0, 3.0),
        (LINE.format(2, 1), 7.0, 15.0),
        ("<PolynomialFunction><coefficients>1 2 3</coefficients></PolynomialFunction>", 2.0, 11.0),
        ("<PolynomialFunction><coefficients>2 3</coefficients></PolynomialFunction>", 2.0, 7.0),
        (
            "<MultiplierFunction><function><Constant><value>3</value></Constant></function>"
            "<scale>-2</scale></MultiplierFunction>",
            0.0,
            -6.0,
        ),
        ("<SimmSpline><x>0 1</x><y>1 3</y></SimmSpline>", 2.0, 5.0),
        ("<NaturalCubicSpline><x>0 1 2</x><y>0 1 0</y></NaturalCubicSpline>", 1.0, 1.0),
    ],
)
def test_a_function_has_its_values(text: str, at: float, value: float, tmp_path: Path) -> None:
    assert function_of(tmp_path, text)(at) == pytest.approx(value)


def test_a_quartic_of_a_quartic_is_itself_and_its_error_is_the_largest(tmp_path: Path) -> None:
    text = "<PolynomialFunction><coefficients>1 -2 0.5 3 -1</coefficients></PolynomialFunction>"
    found = quartic(function_of(tmp_path, text), -1.0, 3.0)
    assert found.coefficients == pytest.approx((-1, 3, 0.5, -2, 1))
    assert found.error < 1e-12
    knee = function_of(tmp_path, SPLINE)
    fit, at = quartic(knee, -1.5, 0.5), np.linspace(-1.5, 0.5, 1000)
    off = np.abs(np.polyval(fit.coefficients[::-1], at) - knee.at(at)).max()
    assert off == pytest.approx(fit.error, rel=0.01)
    assert 1e-6 < fit.error < 5e-4
    assert quartic(straight(2.0, 1.0), 0.0, 0.0).coefficients == (1.0, 2.0, 0, 0, 0)


def read(folder: Path, text: str) -> tuple[Imported, OsimSkeleton, mujoco.MjModel]:
    made = import_text(folder, text)
    root = read_xml(folder / "model.osim").one("Model")
    assert root is not None
    return made, read_skeleton(components(root)), mujoco.MjModel.from_xml_string(made.xml)


def test_an_axis_that_follows_a_spline_is_tied_by_an_equality(tmp_path: Path) -> None:
    axes = (
        axis("rotation1", LINE.format(1, 0), "q", "0 0 1"),
        axis("translation1", SPLINE, "q", "1 0 0"),
        axis("translation2", LINE.format(0.5, 0.1), "q", "0 1 0"),
    )
    text = model(joints=custom(*axes, coordinates=coordinate("q", RANGE)))
    made, skeleton, built = read(tmp_path, text)
    assert set(made.couplings) == {"j_translation1", "j_translation2"}
    assert made.couplings["j_translation2"].polynomial == pytest.approx((0.1, 0.5, 0, 0, 0))
    assert "follows by a quartic, at most" in reasons(made, "q")
    data = mujoco.MjData(built)
    mujoco.mj_resetDataKeyframe(built, data, 0)
    mujoco.mj_kinematics(built, data)
    (spline,) = [s for s in skeleton.followers if s.name == "j_translation1"]
    assert spline.curve is not None
    assert data.body("b").xpos[:2] == pytest.approx([spline.curve(-0.3), 0.1 - 0.15])
    mujoco.mj_fwdPosition(built, data)
    assert np.abs(data.efc_pos[: built.neq]).max() < 1.01 * made.couplings["j_translation1"].error


def test_a_coordinate_that_no_axis_carries_is_a_joint_of_its_own(tmp_path: Path) -> None:
    half = axis("rotation1", LINE.format(0.5, 0), "q", "0 0 1")
    made, _, built = read(tmp_path, model(joints=custom(half, coordinates=coordinate("q", RANGE))))
    assert [built.joint(i).name for i in range(built.njnt)] == ["j_rotation1", "q"]
    assert built.key_qpos[0] == pytest.approx([-0.15, -0.3])
    assert made.couplings["j_rotation1"].coordinate == "q"


@pytest.mark.parametrize(("enforced", "count"), [("true", 1), ("false", 0)])
def test_a_coupler_is_an_equality_of_two_joints(enforced: str, count: int, tmp_path: Path) -> None:
    joints = joint("p", "/ground", "/bodyset/b", coordinate("q", RANGE))
    joints += joint("r", "/bodyset/b", "/bodyset/c", coordinate("r", RANGE))
    coupler = (
        '<ConstraintSet name="constraintset"><objects><CoordinateCouplerConstraint name="tie">'
        f"<isEnforced>{enforced}</isEnforced><coupled_coordinates_function>{LINE.format(2, 0.1)}"
        "</coupled_coordinates_function><independent_coordinate_names>q"
        "</independent_coordinate_names><dependent_coordinate_name>r</dependent_coordinate_name>"
        "<scale_factor>3</scale_factor></CoordinateCouplerConstraint></objects></ConstraintSet>"
    )
    made, _, built = read(tmp_path, model(body("b") + body("c"), joints, rest=coupler))
    assert built.neq == count
    if count:
        assert made.couplings["r"].polynomial == pytest.approx((0.3, 6, 0, 0, 0))
    else:
        assert "not enforced" in reasons(made, "tie")


def test_a_joint_that_cannot_be_read_takes_its_body_and_what_hangs_on_it(tmp_path: Path) -> None:
    joints = joint("p", "/ground", "/bodyset/b", coordinate("q"))
    joints += joint("odd", "/bodyset/b", "/bodyset/c", coordinate("r"), kind="EllipsoidJoint")
    joints += joint("s", "/bodyset/c", "/bodyset/d", coordinate("t"))
    far = point("p0", "/ground", "0 0 0") + point("p1", "/bodyset/d", "1 1 0")
    bodies = body("b") + body("c") + body("d")
    forces = muscle("near", TWO_POINTS) + muscle("far", far)
    made, _, built = read(tmp_path, model(bodies, joints, forces))
    assert [built.body(i).name for i in range(built.nbody)] == ["world", "b"]
    assert (list(made.muscles), made.path_actuators) == (["near"], 2)
    assert "left out with it: c, d" in reasons(made, "odd")
    assert "a body that is left out with the joint 'odd'" in reasons(made, "far")
    alone = joint("odd", "/ground", "/bodyset/b", coordinate("r"), kind="EllipsoidJoint")
    with pytest.raises(InputError, match="EllipsoidJoint cannot be imported"):
        import_text(tmp_path, model(joints=alone))


def coming(low: float, high: float) -> str:
    inside = f"<socket_coordinate>/jointset/p/q</socket_coordinate><range>{low} {high}</range>"
    return point("c", "/ground", "0 1.2 0", "ConditionalPathPoint", inside)


def with_point(low: float, high: float) -> str:
    joints = joint("p", "/ground", "/bodyset/b", coordinate("q", RANGE))
    first, last = point("a", "/ground", "-1 1 0"), point("z", "/bodyset/b", "1 1 0")
    return model(joints=joints, forces=muscle("mus", first + coming(low, high) + last))


def test_a_point_that_is_always_there_is_a_plain_one(tmp_path: Path) -> None:
    made = import_text(tmp_path, with_point(-2, 1))
    assert made.losses == ()
    assert made.xml.count("mus-") == 2 * 3


@pytest.mark.parametrize(("low", "high"), [(-1.5, -1.0), (-1.5, 0.45)])
def test_a_point_that_comes_and_goes_is_sized(low: float, high: float, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="import"):
        _refuse_without_muscles(import_text(tmp_path, with_point(low, high)))
    made = import_osim(tmp_path / "model.osim", tolerance=10.0)
    assert list(made.muscles) == ["mus"]
    told = reasons(made, "mus")
    built = mujoco.MjModel.from_xml_string(made.xml)
    data, off = mujoco.MjData(built), []
    for q in np.linspace(-1.5, 0.5, 2001):
        data.qpos[0] = q
        mujoco.mj_kinematics(built, data)
        mujoco.mj_tendon(built, data)
        end = np.array([np.cos(q) - np.sin(q), np.sin(q) + np.cos(q), 0])
        way = [np.array([-1, 1, 0]), np.array([0, 1.2, 0]), end]
        if not low <= q <= high:
            way.pop(1)
        off.append(abs(data.ten_length[0] - np.linalg.norm(np.diff(way, axis=0), axis=1).sum()))
    stated = re.search(r"at most (\S+) mm off", told)
    assert stated
    assert float(stated[1]) == pytest.approx(1e3 * max(off), rel=0.06)


SWITCH = float(np.arcsin(1.2 / np.hypot(1.2, 0.8)) - np.arctan2(0.8, 1.2))
"""rad, where the line from (-1, 1) to (1, 1), turned, passes (0, 1.2)."""


def tendon_length(built: mujoco.MjModel, made: Imported, q: float) -> tuple[float, float]:
    """The length (m) of the first tendon at q, and by virtual work its arm (m) there."""
    data, slopes = mujoco.MjData(built), np.zeros(built.nv)
    for k in range(built.njnt):
        tied = made.couplings.get(built.joint(k).name)
        series = np.polynomial.Polynomial(tied.polynomial if tied else [0, 1])
        data.qpos[k], slopes[k] = series(q), series.deriv()(q)
    mujoco.mj_kinematics(built, data)
    mujoco.mj_comPos(built, data)
    mujoco.mj_tendon(built, data)
    dense = np.zeros((built.ntendon, built.nv))
    sparse = (built.ten_J_rownnz, built.ten_J_rowadr, built.ten_J_colind)
    mujoco.mju_sparse2dense(dense, data.ten_J, *sparse)
    return float(data.ten_length[0]), float(-dense[0] @ slopes)


def test_a_point_that_comes_where_the_line_reaches_it_bends_the_path_there(tmp_path: Path) -> None:
    """The length is OpenSim's, on either side and at the switch."""
    made = import_text(tmp_path, with_point(-1.5, SWITCH))
    assert "1 of the points that come and go bend the path" in reasons(made, "mus")
    built = mujoco.MjModel.from_xml_string(made.xml)
    for q in (-1.4, -0.3, SWITCH - 1e-3, SWITCH + 1e-3, 0.45):
        end = np.array([np.cos(q) - np.sin(q), np.sin(q) + np.cos(q)])
        way = np.array([(-1, 1), *[(0, 1.2)] * int(q < SWITCH), end])
        length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
        assert tendon_length(built, made, q)[0] == pytest.approx(length, abs=2e-6)


CUBIC = "<PolynomialFunction><coefficients>0.02 0 0.1 0.3</coefficients></PolynomialFunction>"


def moving(functions: tuple[str, str, str], locked: str = "false") -> str:
    inside = "".join(
        f"<{axis}_location>{f}</{axis}_location>"
        f"<socket_{axis}_coordinate>/jointset/p/q</socket_{axis}_coordinate>"
        for axis, f in zip("xyz", functions, strict=True)
    )
    frame = (
        '<components><PhysicalOffsetFrame name="f"><socket_parent>/bodyset/b</socket_parent>'
        "<translation>0 0.5 0</translation><orientation>0 0 0.4</orientation>"
        "</PhysicalOffsetFrame></components>"
    )
    at = f"{RANGE}<locked>{locked}</locked>"
    joints = joint("p", "/ground", "/bodyset/b", coordinate("q", at))
    ends = point("a", "/ground", "-1 1 0"), point("z", "/bodyset/b", "1 1 0")
    between = point("c", "/bodyset/b/f", "0 0 0", "MovingPathPoint", inside)
    forces = muscle("mus", ends[0] + between + ends[1])
    return model(body("b", PLAIN + frame), joints, forces)


def closed_length(q: float, along: float) -> float:
    """Through a point `along` the x of the frame in b, and 0.1 along its y."""
    turn = np.array([[np.cos(q), -np.sin(q)], [np.sin(q), np.cos(q)]])
    inner = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    place = turn @ (np.array([0, 0.5]) + inner @ [along, 0.1])
    way = np.array([(-1, 1), place, turn @ [1, 1]])
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


FIXED = "<Constant><value>{}</value></Constant>"


def test_a_point_that_moves_has_opensim_s_length_and_the_arm_of_virtual_work(
    tmp_path: Path,
) -> None:
    text = moving((CUBIC, FIXED.format(0.1), FIXED.format(0)))
    made = import_text(tmp_path, text)
    built = mujoco.MjModel.from_xml_string(made.xml)
    assert [built.joint(k).name for k in range(built.njnt)] == ["q", "mus-1-x"]
    assert made.couplings["mus-1-x"].error < 1e-12
    assert built.body("mus-1").mass[0] == 1e-9
    assert "bodies of 1e-09 kg" in reasons(made, "mus")
    assert "(no weight) on each slide" in reasons(made, "mus")
    assert len(set(made.losses)) == len(made.losses)

    def length(q: float) -> float:
        return closed_length(q, 0.02 * q**3 + 0.1 * q + 0.3)

    for q in (-1.4, -0.3, 0.4):
        found, arm = tendon_length(built, made, q)
        assert found == pytest.approx(length(q), abs=1e-9)
        assert arm == pytest.approx(-(length(q + 1e-5) - length(q - 1e-5)) / 2e-5, abs=1e-8)
    data = mujoco.MjData(built)
    mujoco.mj_resetDataKeyframe(built, data, 0)
    mujoco.mj_forward(built, data)
    assert data.ten_length[0] == pytest.approx(length(-0.3), abs=1e-9)


def test_a_slide_gives_way_to_a_tendon_by_little(tmp_path: Path) -> None:
    text = moving((CUBIC, FIXED.format(0.1), FIXED.format(0)))
    made = import_text(tmp_path, text)
    built = mujoco.MjModel.from_xml_string(made.xml)
    built.opt.gravity[:] = 0
    data = mujoco.MjData(built)
    mujoco.mj_resetDataKeyframe(built, data, 0)
    data.ctrl[0] = 100.0
    series = np.polynomial.Polynomial(made.couplings["mus-1-x"].polynomial)
    for _ in range(25):
        mujoco.mj_step(built, data)
        assert abs(data.qpos[1] - series(data.qpos[0])) < 1e-4


def test_the_quartic_of_a_point_that_moves_counts_against_the_tolerance(tmp_path: Path) -> None:
    """Its spline turns sharper than a quartic can."""
    sharp = "<PiecewiseLinearFunction><x>-1.5 0 0.5</x><y>0.3 0.3 0.4</y></PiecewiseLinearFunction>"
    text = moving((sharp, FIXED.format(0.1), FIXED.format(0)))
    assert not import_text(tmp_path, text).muscles
    made = import_osim(tmp_path / "model.osim", tolerance=0.1)
    built = mujoco.MjModel.from_xml_string(made.xml)
    off = [
        abs(tendon_length(built, made, q)[0] - closed_length(q, 0.3 + 0.2 * max(q, 0)))
        for q in np.linspace(-1.5, 0.5, 401)
    ]
    stated = re.search(r"at most (\S+) mm off OpenSim", reasons(made, "mus"))
    assert stated
    assert float(stated[1]) == pytest.approx(1e3 * max(off), rel=0.1)


def test_a_point_that_moves_by_a_locked_coordinate_stands(tmp_path: Path) -> None:
    text = moving((CUBIC, FIXED.format(0.1), FIXED.format(0)), locked="true")
    made = import_text(tmp_path, text)
    built = mujoco.MjModel.from_xml_string(made.xml)
    assert built.njnt == 0
    data = mujoco.MjData(built)
    mujoco.mj_forward(built, data)
    along = 0.02 * (-0.3) ** 3 + 0.1 * -0.3 + 0.3
    assert data.ten_length[0] == pytest.approx(closed_length(-0.3, along), abs=1e-9)


def test_a_coordinate_of_a_name_that_is_taken_is_called_by_its_joint_too(tmp_path: Path) -> None:
    """A point that depends on it names it by its path; a bare name means the first."""
    joints = joint("p", "/ground", "/bodyset/b", coordinate("q", RANGE))
    joints += joint("k", "/bodyset/b", "/bodyset/c", coordinate("q", RANGE.replace("-0.3", "0.2")))
    first, last = point("a", "/ground", "-1 1 0"), point("z", "/bodyset/b", "1 1 0")
    always = coming(-2, 1).replace("/jointset/p/q", "/jointset/k/q")
    limit = '<CoordinateLimitForce name="l"><coordinate>q</coordinate></CoordinateLimitForce>'
    forces = muscle("mus", first + always + last) + limit
    made, skeleton, built = read(tmp_path, model(body("b") + body("c"), joints, forces))
    assert list(made.coordinates) == ["q", "k/q"]
    assert [built.joint(i).name for i in range(built.njnt)] == ["q", "k/q"]
    assert built.key_qpos[0] == pytest.approx([-0.3, 0.2])
    assert "it is called k/q" in reasons(made, '"k" > Coordinate "q"')
    assert made.limits["l"].coordinate == "q"
    said = ("/jointset/k/q", "../../k/q", "q", "/jointset/p/q", "r")
    assert [skeleton.named(name) for name in said] == ["k/q", "k/q", "q", "q", None]


def test_limits_and_couplers_of_joints_that_were_not_asked_for_are_in_the_one_line(
    tmp_path: Path,
) -> None:
    force = '<CoordinateLimitForce name="far"><coordinate>r</coordinate></CoordinateLimitForce>'
    tie = (
        '<ConstraintSet name="constraintset"><objects><CoordinateCouplerConstraint name="tie">'
        "<independent_coordinate_names>q</independent_coordinate_names><dependent_coordinate_name>"
        "r</dependent_coordinate_name></CoordinateCouplerConstraint></objects></ConstraintSet>"
    )
    made = import_text(tmp_path, model(THREE, BRANCHED, force, tie), ("b",))
    assert {loss.group for loss in made.losses if "far" in loss.place} == {"unasked"}
    assert {loss.group for loss in made.losses if "tie" in loss.place} == {"unasked"}


def _refuse_without_muscles(made: Imported) -> None:
    if not made.muscles:
        raise InputError("import")


def test_what_opensim_does_without_is_made_up_and_told(tmp_path: Path) -> None:
    text = model(forces="<SpringGeneralizedForce><coordinate>q</coordinate>"
                        "<stiffness>1</stiffness></SpringGeneralizedForce>")  # fmt: skip
    made = import_text(tmp_path, text.replace('<Ground name="ground"/>', ""))
    assert "OpenSim's own is taken" in reasons(made, '"m"')
    assert "it has no name" in reasons(made, "springgeneralizedforce_in_line")
    assert len(made.springs) == 1


@pytest.mark.parametrize("share", [0.05, 0.4])
def test_inertia_of_no_solid_is_balanced_and_told(share: float, tmp_path: Path) -> None:
    inertia = f"<mass>1</mass><inertia>1 1 {2 / (1 - share)} 0 0 0</inertia>"
    made = import_text(tmp_path, model(body("b", inertia)))
    assert "those of no solid" in reasons(made, '"b"')
    principal = np.sort(mujoco.MjModel.from_xml_string(made.xml).body("b").inertia)
    assert principal[0] + principal[1] >= principal[2] * (1 - 1e-9)
    assert PLAIN.startswith("<mass>1</mass>")


def test_a_muscle_whose_length_jumps_is_left_out_with_the_size(tmp_path: Path) -> None:
    """It passes a cylinder on the side of its quadrant until it lies beyond."""
    wrap = (
        '<WrapObjectSet name="wrapobjectset"><objects><WrapCylinder name="head"><radius>0.3'
        "</radius><length>4</length><quadrant>-x</quadrant></WrapCylinder></objects>"
        "</WrapObjectSet>"
    )
    use = '<PathWrap name="pw"><wrap_object>head</wrap_object></PathWrap>'
    ends = point("a", "/ground", "0.1 1 0") + point("z", "/bodyset/b", "0 -1 0")

    def made(span: str) -> Imported:
        inside = f"<range>{span}</range>"
        joints = joint("p", "/ground", "/bodyset/b", coordinate("q", inside))
        ground = f'<Ground name="ground">{wrap}</Ground>'
        text = model(joints=joints, forces=muscle("mus", ends, use))
        return import_text(tmp_path, text.replace('<Ground name="ground"/>', ground))

    assert list(made("-0.5 0.1").muscles) == ["mus"]
    jumping = made("-0.5 2.9")
    assert not jumping.muscles
    assert "mm off OpenSim's path" in reasons(jumping, "mus")
    assert jumping.beyond["mus"] > 0.3


THREE = body("b") + body("c") + body("d")
BRANCHED = (
    PIN
    + joint("to_c", "/bodyset/b", "/bodyset/c", coordinate("r"))
    + joint("to_d", "/bodyset/b", "/bodyset/d", coordinate("s"), kind="ScapulothoracicJoint")
)
TO_D = point("p0", "/ground", "-1 1 0") + point("p1", "/bodyset/d", "1 1 0")
OVER_ALL = muscle("short", TWO_POINTS) + muscle("long", TWO_POINTS) + muscle("far", TO_D)
MARK = (
    '<MarkerSet name="markerset"><objects><Marker name="on_d"><socket_parent_frame>/bodyset/d'
    "</socket_parent_frame></Marker></objects></MarkerSet>"
)


@pytest.mark.parametrize(
    ("only", "bodies", "muscles", "of"),
    [
        ((), {"b", "c"}, ["short", "long"], 3),
        (("c",), {"b", "c"}, ["short", "long"], 2),
        (("b",), {"b"}, ["short", "long"], 2),
        (("s*",), {"b", "c"}, ["short"], 1),
        (("b", "?on[g]"), {"b"}, ["long"], 1),
    ],
)
def test_only_what_is_asked_for_comes(
    tmp_path: Path, only: tuple[str, ...], bodies: set[str], muscles: list[str], of: int
) -> None:
    made = import_text(tmp_path, model(THREE, BRANCHED, OVER_ALL, MARK), only)
    compiled = mujoco.MjModel.from_xml_string(made.xml)
    assert {compiled.body(i).name for i in range(1, compiled.nbody)} == bodies
    assert list(made.muscles) == muscles
    assert made.path_actuators == of
    told = "\n".join(report(made.losses))
    assert ("ScapulothoracicJoint" in told) == (not set(only) & {"b", "c"})
    assert ("not asked for" in told) == bool(only)


def test_a_name_that_is_not_there_is_met_with_those_near_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'shrot'; near it are short"):
        import_text(tmp_path, model(THREE, BRANCHED, OVER_ALL), ("b", "shrot"))
