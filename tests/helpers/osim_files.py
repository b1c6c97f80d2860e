"""Small .osim texts for the tests of the importer; m, rad, kg."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigid.opensim.osim import Imported, import_osim

PLAIN = "<mass>1</mass><inertia>1 1 1 0 0 0</inertia>"


def body(name: str, inside: str = PLAIN) -> str:
    return f'<Body name="{name}">{inside}</Body>'


def coordinate(name: str, inside: str = "") -> str:
    return f'<Coordinate name="{name}">{inside}</Coordinate>'


def joint(
    name: str,
    parent: str,
    child: str,
    coordinates: str = "",
    inside: str = "",
    kind: str = "PinJoint",
) -> str:
    return (
        f'<{kind} name="{name}"><socket_parent_frame>{parent}</socket_parent_frame>\n'
        f"<socket_child_frame>{child}</socket_child_frame>"
        f"<coordinates>{coordinates}</coordinates>{inside}</{kind}>"
    )


def axis(name: str, function: str, of: str = "", along: str = "1 0 0") -> str:
    return (
        f'<TransformAxis name="{name}"><coordinates>{of}</coordinates><axis>{along}</axis>'
        f"{function}</TransformAxis>"
    )


def custom(*axes: str, coordinates: str = "", parent: str = "/ground", child: str = "b") -> str:
    inside = f"<SpatialTransform>{''.join(axes)}</SpatialTransform>"
    return joint("j", parent, f"/bodyset/{child}", coordinates, inside, "CustomJoint")


def point(name: str, frame: str, at: str, kind: str = "PathPoint", inside: str = "") -> str:
    return (
        f'<{kind} name="{name}"><socket_parent_frame>{frame}</socket_parent_frame>'
        f"<location>{at}</location>{inside}</{kind}>"
    )


NUMBERS = {
    **{"max_isometric_force": "10", "optimal_fiber_length": "0.05"},
    **{"tendon_slack_length": "0.3", "pennation_angle_at_optimal": "0.1"},
}
STATED = "".join(f"<{key}>{value}</{key}>" for key, value in NUMBERS.items())


def muscle(name: str, points: str, wraps: str = "", inside: str = STATED) -> str:
    return (
        f'<Millard2012EquilibriumMuscle name="{name}"><GeometryPath name="path"><PathPointSet>'
        f"<objects>{points}</objects></PathPointSet><PathWrapSet><objects>{wraps}</objects>"
        f"</PathWrapSet></GeometryPath>{inside}</Millard2012EquilibriumMuscle>"
    )


PIN = joint("pin", "/ground", "/bodyset/b", coordinate("q"))
TWO_POINTS = point("p0", "/ground", "-1 1 0") + point("p1", "/bodyset/b", "1 1 0")


def model(
    bodies: str = body("b"),
    joints: str = PIN,
    forces: str = "",
    rest: str = "",
    version: str = "40600",
) -> str:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<OpenSimDocument Version="{version}">\n'
        f'<Model name="m"><Ground name="ground"/>\n'
        f'<BodySet name="bodyset"><objects>\n{bodies}\n</objects></BodySet>\n'
        f'<JointSet name="jointset"><objects>\n{joints}\n</objects></JointSet>\n'
        f'<ForceSet name="forceset"><objects>\n{forces}\n</objects></ForceSet>\n'
        f"{rest}</Model></OpenSimDocument>\n"
    )


_INERTIA = "".join(f"<inertia_{k}>{v}</inertia_{k}>" for k, v in zip(
    ("xx", "yy", "zz", "xy", "yz"), (1, 2, 2.5, 0.1, 0.2), strict=True))  # fmt: skip
_OLD_WRAP = (
    '<WrapObjectSet><objects><WrapCylinder name="head"><xyz_body_rotation>0 0 0.1'
    "</xyz_body_rotation><translation>0 0.5 0</translation><quadrant>x</quadrant><radius>0.1"
    "</radius><length>1</length><VisibleObject name='v'><show_axes>false</show_axes>"
    "</VisibleObject></WrapCylinder></objects></WrapObjectSet>"
)
_OLD_SPLINE = "<SimmSpline><x>-1 0 1 2</x><y>0 0.01 0 0.01</y></SimmSpline>"
_OLD_AXES = "".join(
    f'<TransformAxis name="{name}"><coordinates>{of}</coordinates><axis>{axis}</axis>'
    f"<function>{function}</function></TransformAxis>"
    for name, of, axis, function in (
        (
            *("rotation1", "q", "0 0 1"),
            "<LinearFunction><coefficients>1 0</coefficients></LinearFunction>",
        ),
        ("rotation2", "", "0 1 0", "<Constant><value>0</value></Constant>"),
        ("rotation3", "", "1 0 0", "<Constant><value>0</value></Constant>"),
        ("translation1", "q", "1 0 0", _OLD_SPLINE),
        ("translation2", "", "0 1 0", "<Constant><value>0.2</value></Constant>"),
        ("translation3", "", "0 0 1", "<Constant><value>0</value></Constant>"),
    )
)


def old_point(name: str, of: str, at: str, kind: str = "PathPoint", inside: str = "") -> str:
    return f'<{kind} name="{name}"><location>{at}</location><body>{of}</body>{inside}</{kind}>'


_OLD_PATH = old_point("p0", "ground", "0.3 1 0") + old_point("p1", "b", "0.4 -0.5 0")
OLD_MODEL = f"""<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="30000"><Model name="m">
<defaults><Thelen2003Muscle name="default"><isDisabled>false</isDisabled>
<max_isometric_force>546</max_isometric_force><Af>0.3</Af></Thelen2003Muscle></defaults>
<length_units>meters</length_units><gravity>0 0 -9.8</gravity>
<!-- two -- hyphens -->
<BodySet name="bodies"><objects>
<Body name="ground"><mass>0</mass>{_INERTIA}<Joint/>{_OLD_WRAP}</Body>
<Body name="b"><mass>1</mass><mass_center>0 -0.1 0</mass_center>{_INERTIA}
<Joint><CustomJoint name="j"><parent_body>ground</parent_body>
<location_in_parent>0.1 0.2 0.3</location_in_parent>
<orientation_in_parent>0.1 0 0.2</orientation_in_parent><location>0 0.05 0</location>
<orientation>0 0.3 0</orientation><CoordinateSet><objects><Coordinate name="q">
<motion_type>rotational</motion_type><default_value>0.2</default_value><range>-1 1</range>
<locked>false</locked></Coordinate></objects><groups/></CoordinateSet><reverse>false</reverse>
<SpatialTransform>{_OLD_AXES}</SpatialTransform></CustomJoint></Joint></Body>
<Body name="c"><mass>1</mass>{_INERTIA}<Joint><PinJoint name="k"><parent_body>b</parent_body>
<CoordinateSet><objects><Coordinate name="r"><range>0 1</range></Coordinate></objects>
</CoordinateSet></PinJoint></Joint></Body>
</objects></BodySet>
<ForceSet name="forces"><objects>
<Thelen2003Muscle name="over"><isDisabled>false</isDisabled><Af>0.4</Af><GeometryPath>
<PathPointSet><objects>{_OLD_PATH}</objects></PathPointSet><PathWrapSet><objects><PathWrap name="w">
<wrap_object>head</wrap_object></PathWrap></objects></PathWrapSet></GeometryPath></Thelen2003Muscle>
<Thelen2003Muscle name="off"><isDisabled>true</isDisabled><GeometryPath>
<PathPointSet><objects>{_OLD_PATH}</objects></PathPointSet></GeometryPath></Thelen2003Muscle>
<CoordinateLimitForce name="l"><isDisabled>false</isDisabled><coordinate>q</coordinate>
</CoordinateLimitForce></objects></ForceSet>
<MarkerSet><objects><Marker name="mark"><body>b</body><location>0 1 0</location>
<fixed>false</fixed></Marker></objects></MarkerSet></Model></OpenSimDocument>
"""
"""In the layout of OpenSim 3."""


def import_text(folder: Path, text: str, only: Sequence[str] = ()) -> Imported:
    """The import of a text, by way of a file."""
    path = folder / "model.osim"
    path.write_text(text, encoding="utf-8")
    return import_osim(path, only=only)


def reasons(result: Imported, place: str) -> str:
    """What was dropped or changed of the elements whose place holds that text."""
    return "; ".join(str(loss) for loss in result.losses if place in loss.place)
