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


def muscle(name: str, points: str, wraps: str = "", inside: str = "") -> str:
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


def import_text(folder: Path, text: str, only: Sequence[str] = ()) -> Imported:
    """The import of a text, by way of a file."""
    path = folder / "model.osim"
    path.write_text(text, encoding="utf-8")
    return import_osim(path, only=only)


def reasons(result: Imported, place: str) -> str:
    """What was dropped or changed of the elements whose place holds that text."""
    return "; ".join(str(loss) for loss in result.losses if place in loss.place)
