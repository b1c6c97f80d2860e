"""What the import of an OpenSim model drops or changes is told, element by element."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from cosim.errors import InputError
from rigid.opensim.osim import import_osim
from tests.helpers.osim_files import (
    PIN,
    PLAIN,
    TWO_POINTS,
    body,
    coordinate,
    import_text,
    joint,
    model,
    muscle,
    point,
    reasons,
)
from tests.proofs.fingers.osim_rows import shipped_models

CONTACT = """<HuntCrossleyForce name="contact">
<HuntCrossleyForce::ContactParametersSet name="contact_parameters"><objects>
<HuntCrossleyForce::ContactParameters><stiffness>1e6</stiffness>
</HuntCrossleyForce::ContactParameters></objects>
</HuntCrossleyForce::ContactParametersSet></HuntCrossleyForce>"""
OTHERS = """
<ConstraintSet name="constraintset"><objects><WeldConstraint name="loop"/>
<CoordinateCouplerConstraint name="couple"><isEnforced>true</isEnforced>
</CoordinateCouplerConstraint></objects></ConstraintSet>
<ControllerSet name="controllerset"><objects><PrescribedController name="ctl">
<enabled>true</enabled></PrescribedController></objects></ControllerSet>
<ContactGeometrySet name="cg"><objects><ContactSphere name="ball"><radius>1</radius>
</ContactSphere></objects></ContactGeometrySet>
<ProbeSet name="p"><objects><JointInternalPowerProbe name="power"><gain>1</gain>
</JointInternalPowerProbe></objects></ProbeSet>"""
FORCES = """<BushingForce name="bush"><appliesForce>true</appliesForce></BushingForce>
<Ligament name="lig"><GeometryPath name="path"/></Ligament>
<CoordinateActuator name="motor"><coordinate>q</coordinate></CoordinateActuator>"""


def test_a_plain_model_loses_nothing(tmp_path: Path) -> None:
    assert import_text(tmp_path, model(forces=muscle("mus", TWO_POINTS))).losses == ()


def test_what_a_file_says_without_effect_is_no_loss(tmp_path: Path) -> None:
    inside = "<default_speed_value>{}</default_speed_value><prescribed>{}</prescribed>"
    inside += "<is_free_to_satisfy_constraints>{}</is_free_to_satisfy_constraints>"
    for words, losses in ((("0", "false", "false"), 0), (("0.1", "true", "true"), 3)):
        pin = joint("pin", "/ground", "b", coordinate("q", inside.format(*words)))
        assert len(import_text(tmp_path, model(joints=pin, rest="<groups/>")).losses) == losses


def test_the_finger_loses_what_it_must_and_no_more() -> None:
    finger, _ = shipped_models()
    lost = [
        (loss.what, loss.place.rpartition(" > ")[2]) for loss in finger.losses if not loss.group
    ]
    passive = [f'CoordinateLimitForce "{name}_limit"' for name in finger.coordinates]
    passive.append('SpringGeneralizedForce "MCP_spring"')
    expected = ['Coordinate "DIP"', *passive]
    assert sorted(lost) == sorted(("changed", place) for place in expected)


def test_names_with_colons_are_told_as_they_are_written(tmp_path: Path) -> None:
    made = import_text(tmp_path, model(rest='<A::B name="x">1</A::B>'))
    assert [loss.place for loss in made.losses] == ['A::B "x"']


def test_everything_that_is_not_imported_is_named(tmp_path: Path) -> None:
    made = import_text(tmp_path, model(forces=CONTACT + FORCES, rest=OTHERS))
    named = re.findall(r'(\w+) "(\w+)": ', "\n".join(str(loss) for loss in made.losses))
    assert sorted(name for _, name in named) == sorted(
        ["contact", "bush", "lig", "motor", "couple", "ctl", "ball", "power"]
    )
    assert "contact is not imported" in reasons(made, "HuntCrossleyForce")
    assert "are free" in reasons(made, "couple")
    assert all(loss.what == "dropped" and loss.line > 8 for loss in made.losses)


def test_a_massless_moving_body_gets_a_little_and_says_so(tmp_path: Path) -> None:
    empty = "<mass>0</mass><inertia>0 0 0 0 0 0</inertia>"
    bodies = body("b") + body("between", empty)
    joints = joint("p", "/ground", "/bodyset/between", coordinate("q"))
    joints += joint("r", "/bodyset/between", "/bodyset/b", coordinate("r"))
    made = import_text(tmp_path, model(bodies, joints))
    told = reasons(made, "between")
    assert "1e-09 kg here" in told
    assert "1e-12 more about each axis" in told
    built = mujoco.MjModel.from_xml_string(made.xml)
    assert built.body("between").mass == 1e-9
    assert_allclose(built.body("between").inertia, 1e-12, rtol=1e-12)
    assert built.body("b").mass == 1


def test_a_point_mass_keeps_its_mass(tmp_path: Path) -> None:
    made = import_text(tmp_path, model(body("b", "<mass>3</mass>")))
    assert "kg:" not in reasons(made, '"b"')
    assert mujoco.MjModel.from_xml_string(made.xml).body("b").mass == 3


def test_a_welded_point_mass_is_taken_too(tmp_path: Path) -> None:
    bodies = body("b") + body("lead", "<mass>3</mass>")
    joints = PIN + joint("w", "/bodyset/b", "/bodyset/lead", kind="WeldJoint")
    made = import_text(tmp_path, model(bodies, joints))
    assert "least moment of inertia 0" in reasons(made, "lead")
    assert mujoco.MjModel.from_xml_string(made.xml).body("lead").mass == 3


def test_a_massless_welded_body_stays_massless(tmp_path: Path) -> None:
    bodies = body("b") + body("frame", "<mass>0</mass>")
    joints = PIN + joint("w", "/bodyset/b", "/bodyset/frame", kind="WeldJoint")
    made = import_text(tmp_path, model(bodies, joints))
    assert made.losses == ()
    assert mujoco.MjModel.from_xml_string(made.xml).body("frame").mass == 0


@pytest.mark.parametrize("kind", ["ConditionalPathPoint", "MovingPathPoint"])
def test_a_path_with_a_point_that_depends_on_nothing_goes_with_its_muscle(
    kind: str, tmp_path: Path
) -> None:
    points = TWO_POINTS + point("c", "/bodyset/b", "2 1 0", kind, "<range>0 1</range>")
    made = import_text(tmp_path, model(forces=muscle("bad", points) + muscle("good", TWO_POINTS)))
    assert list(made.muscles) == ["good"]
    (loss,) = made.losses
    assert loss.what == "dropped"
    assert "path point 'c'" in loss.reason


def wrap_model(kind: str, inside: str, use: str = "", more: str = "") -> str:
    """A body with a wrap at its origin, and a muscle of three points past it."""
    radius = "<radius>0.5</radius>" if kind in ("WrapCylinder", "WrapSphere") else ""
    objects = f'<{kind} name="w">{radius}{inside}</{kind}>{more}'
    holder = f'<WrapObjectSet name="wrapobjectset"><objects>{objects}</objects></WrapObjectSet>'
    points = (
        point("a", "/ground", "-1 0.6 0")
        + point("b", "/bodyset/b", "1 -0.4 0")
        + point("c", "/bodyset/b", "2 0 0")
    )
    uses = f'<PathWrap name="pathwrap"><wrap_object>w</wrap_object>{use}</PathWrap>'
    if more:
        uses += '<PathWrap name="pathwrap"><wrap_object>v</wrap_object></PathWrap>'
    pin = joint("pin", "/ground", "/bodyset/b", coordinate("q", "<range>-0.1 0.1</range>"))
    return model(body("b", holder + PLAIN), pin, muscle("mus", points, uses))


def length(text: str) -> float:
    built = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(built)
    mujoco.mj_forward(built, data)
    return float(data.ten_length[0])


STRAIGHT = np.hypot(2, 1) + np.hypot(1, 0.4)


def around(start: np.ndarray, end: np.ndarray, radius: float, angle: float) -> float:
    """Two tangents and the arc between points `angle` apart as seen from the axis."""
    near, far = np.linalg.norm(start), np.linalg.norm(end)
    arc = angle - np.arccos(radius / near) - np.arccos(radius / far)
    return float(np.sqrt(near**2 - radius**2) + np.sqrt(far**2 - radius**2) + radius * arc)


@pytest.mark.parametrize("kind", ["WrapCylinder", "WrapSphere"])
@pytest.mark.parametrize(("quadrant", "above"), [("all", True), ("+y", True), ("-y", False)])
def test_a_path_goes_round_a_surface_on_its_side(
    kind: str, quadrant: str, above: bool, tmp_path: Path
) -> None:
    made = import_text(tmp_path, wrap_model(kind, f"<quadrant>{quadrant}</quadrant>"))
    start, end = np.array([-1, 0.6]), np.array([1, -0.4])
    angle = np.arccos(start @ end / np.linalg.norm(start) / np.linalg.norm(end))
    angle = angle if above else 2 * np.pi - angle
    expected = around(start, end, 0.5, angle) + np.hypot(1, 0.4)
    assert_allclose(length(made.xml), expected, rtol=1e-9)
    assert made.losses == ()


def test_an_inactive_surface_is_left_out(tmp_path: Path) -> None:
    made = import_text(tmp_path, wrap_model("WrapSphere", "<active>false</active>"))
    assert_allclose(length(made.xml), STRAIGHT)
    assert "not active" in reasons(made, "PathWrap")


def test_the_range_of_a_wrap_is_kept(tmp_path: Path) -> None:
    made = import_text(tmp_path, wrap_model("WrapSphere", "", "<range>2 3</range>"))
    assert_allclose(length(made.xml), STRAIGHT)


def test_a_surface_over_several_segments_is_told(tmp_path: Path) -> None:
    text = (
        wrap_model("WrapSphere", "")
        .replace("1 -0.4 0", "0.6 -0.4 0")
        .replace("2 0 0", "-0.6 -0.4 0")
    )
    assert list(import_text(tmp_path, text).beyond) == ["mus"]
    made = import_osim(tmp_path / "model.osim", tolerance=1.0)
    assert "'w' may bend several segments, in OpenSim one at a time" in reasons(made, "mus")


def test_a_cylinder_that_ends_where_mujoco_s_goes_on_is_sized(tmp_path: Path) -> None:
    text = wrap_model("WrapCylinder", "<length>0.3</length>", "<range>1 2</range>")
    text = text.replace("-1 0.6 0", "-1 0.6 2").replace("1 -0.4 0", "1 -0.4 2")
    made = import_text(tmp_path, text)
    (off,) = made.beyond.values()
    made = import_osim(tmp_path / "model.osim", tolerance=1.01 * off)
    built = mujoco.MjModel.from_xml_string(made.xml)
    assert_allclose(built.geom("w").size[:2], [0.5, 0.15])
    assert built.geom("w").contype == built.geom("w").conaffinity == 0
    data, far = mujoco.MjData(built), []
    for q in np.linspace(*made.coordinates["q"].range, 21):
        data.qpos[0] = q
        mujoco.mj_forward(built, data)
        a, b, c = (data.site(f"mus-{k}").xpos for k in range(3))
        far.append(data.ten_length[0] - np.linalg.norm(b - a) - np.linalg.norm(c - b))
    assert_allclose(off, max(far), rtol=0.1)


ROUND = "<dimensions>0.5 0.5 0.5</dimensions>"
LONG = "<dimensions>0.5 0.3 0.4</dimensions>"
RING = "<inner_radius>0.3</inner_radius><outer_radius>0.31</outer_radius>"
UPRIGHT = "<xyz_body_rotation>0 1.5708 0</xyz_body_rotation>"
SECOND = '<WrapSphere name="v"><radius>0.1</radius></WrapSphere>'


@pytest.mark.parametrize(
    ("kind", "inside", "more", "told"),
    [
        ("WrapEllipsoid", ROUND, "", "a sphere of 500 mm for WrapEllipsoid 'w' between a and b"),
        ("WrapEllipsoid", LONG, "", "mm for WrapEllipsoid 'w' between a and b"),
        ("WrapTorus", RING + UPRIGHT, "", "mm for WrapTorus 'w' between a and b"),
        ("WrapSphere", "", SECOND, "no WrapSphere 'v' between a and b"),
    ],
)
def test_what_mujoco_cannot_wrap_has_a_stand_in_whose_size_is_told(
    kind: str, inside: str, more: str, told: str, tmp_path: Path
) -> None:
    text = wrap_model(kind, inside, "<range>1 2</range>", more)
    first = import_text(tmp_path, text)
    size = first.beyond.get("mus", 1e-4)
    made = import_osim(tmp_path / "model.osim", tolerance=1.01 * size)
    assert list(made.muscles) == ["mus"]
    if told.startswith("no"):
        assert "mus" not in first.beyond  # the smaller sphere lies within the other
    else:
        assert told in reasons(made, '"mus"')
        assert size < 0.02
    assert reasons(made, '"w"') == ""


LIMIT = """<CoordinateLimitForce name="limit"><coordinate>q</coordinate>
<upper_limit>10</upper_limit><upper_stiffness>20</upper_stiffness><lower_limit>-10</lower_limit>
<lower_stiffness>20</lower_stiffness><damping>0.3</damping><transition>5</transition>
</CoordinateLimitForce>"""
SPRING = """<SpringGeneralizedForce name="spring"><coordinate>q</coordinate><stiffness>2</stiffness>
<rest_length>0.1</rest_length><viscosity>0.3</viscosity></SpringGeneralizedForce>"""


def test_a_limit_force_is_opensims_torque_by_our_own_law(tmp_path: Path) -> None:
    made = import_text(tmp_path, model(forces=LIMIT + SPRING))
    law = made.law(("q",))
    degrees = np.array([0.0, 12.0, 15.0, 20.0, -20.0])
    torque = [law.limit(np.array([q]))[0][0] for q in np.radians(degrees)]
    # N m, CoordinateLimitForce.calcLimitForce of OpenSim 4.6 at these angles and no speed
    assert_allclose(torque, [0.0, -12.6976, -100.0, -200.0, 200.0], rtol=1e-12, atol=1e-12)
    # the same, SpringGeneralizedForce at 12 deg
    assert_allclose(law.passive(np.radians([12.0]))[0], [-0.2188790204786391], rtol=1e-14)
    # at 12 deg and 1 rad/s the limit's is -18.1539916745899 N m; the spring's has 0.3 more
    damped = law.viscous(np.radians([12.0]), np.ones(1))[0]
    assert_allclose(damped, [-(18.1539916745899 - 12.6976) - 0.3], rtol=1e-12)
    assert all("JSON" in loss.reason for loss in made.losses)


def test_a_limit_of_a_slide_is_in_metres(tmp_path: Path) -> None:
    slide = joint("s", "/ground", "/bodyset/b", coordinate("q"), kind="SliderJoint")
    made = import_text(tmp_path, model(joints=slide, forces=LIMIT))
    limit = made.limits["limit"]
    assert (limit.upper, limit.upper_stiffness, limit.transition) == (10.0, 20.0, 5.0)


def test_limits_that_our_law_cannot_hold_are_refused(tmp_path: Path) -> None:
    soft = LIMIT.replace("<lower_stiffness>20", "<lower_stiffness>19")
    with pytest.raises(InputError, match="one stiffness, transition and damping"):
        import_text(tmp_path, model(forces=soft)).law(("q",))
    twice = LIMIT + LIMIT.replace('"limit"', '"limit2"')
    with pytest.raises(InputError, match="several act"):
        import_text(tmp_path, model(forces=twice)).law(("q",))


def test_a_muscle_that_applies_no_force_is_dropped(tmp_path: Path) -> None:
    off = muscle("mus", TWO_POINTS, inside="<appliesForce>false</appliesForce>")
    made = import_text(tmp_path, model(forces=off))
    assert made.muscles == {}
    assert "applies no force" in reasons(made, "mus")
