"""OpenSim files that nobody vouches for: one message that says where and what, nothing worse."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim.errors import InputError
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
)

LINEAR = "<LinearFunction><coefficients>{}</coefficients></LinearFunction>"
BOMB = """<?xml version="1.0"?>
<!DOCTYPE lolz [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>
<OpenSimDocument Version="40600"><Model name="&b;"/></OpenSimDocument>"""
LOOP = body("b") + body("c")
CIRCLE = joint("j", "/bodyset/c", "/bodyset/b", coordinate("q")) + joint(
    "k", "/bodyset/b", "/bodyset/c", coordinate("r")
)
SELF = f"""<components><PhysicalOffsetFrame name="f"><socket_parent>/bodyset/b/g</socket_parent>
</PhysicalOffsetFrame><PhysicalOffsetFrame name="g"><socket_parent>/bodyset/b/f</socket_parent>
</PhysicalOffsetFrame></components>{PLAIN}"""
SOME_WRAP = """<WrapObjectSet name="w"><objects><WrapSphere name="w">{}</WrapSphere></objects>
</WrapObjectSet>"""
USE = '<PathWrap name="p"><wrap_object>w</wrap_object>{}</PathWrap>'


def limit(of: str) -> str:
    return f'<CoordinateLimitForce name="l"><coordinate>{of}</coordinate></CoordinateLimitForce>'


def custom_of(function: str, of: str = "q", names: str = "q") -> str:
    coordinates = "".join(map(coordinate, names))
    return custom(axis("rotation1", function, of), coordinates=coordinates)


def over(wrap: str, use: str = "") -> str:
    forces = muscle("mus", TWO_POINTS, USE.format(use))
    return model(body("b", SOME_WRAP.format(wrap) + PLAIN), forces=forces)


CASES = {
    "not xml": ("this is no XML", ("line 1", "not well-formed")),
    "empty": ("", ("not well-formed",)),
    "truncated": (model()[:400], ("not well-formed",)),
    "another root": ("<mujoco/>", ("<mujoco>", "<OpenSimDocument>")),
    "no model": ('<OpenSimDocument Version="40000"><X/></OpenSimDocument>', ("no <Model>",)),
    "no version": ("<OpenSimDocument><Model/></OpenSimDocument>", ("Version", "40600")),
    "layout of 1": (model(version="10905"), ("line 2", "OpenSim 1", "save it")),
    "entities": (BOMB, ("line 2", "entities", "<!DOCTYPE")),
    "encoding": ('<?xml version="1.0" encoding="UTF-16"?><a/>', ("UTF-16", "UTF-8")),
    "deep": ("<OpenSimDocument>" + "<a>" * 60 + "</a>" * 60, ("not well-formed",)),
    "deep but closed": (
        f"<OpenSimDocument>{'<a>' * 100}{'</a>' * 100}</OpenSimDocument>",
        ("nested more than",),
    ),
    "NaN mass": (model(body("b", "<mass>NaN</mass>")), ("line 5", '"b" > mass', "'NaN'")),
    "no mass": (model(body("b", "")), ('Body "b"', "<mass> is missing")),
    "short vector": (
        model(body("b", "<mass>1</mass><mass_center>0 0</mass_center>")),
        ("mass_center", "3 numbers", "'0 0'"),
    ),
    **{
        f"{key} {value or 'nothing'}": (
            model(forces=muscle("m", TWO_POINTS, "", f"<{key}>{value}</{key}>")),
            ('"m"', f"> {key}: expected"),
        )
        for key, values in {
            "max_isometric_force": ("-30", "1e29", "", "1_0"),
            "optimal_fiber_length": ("-0.1", "0", "1e3"),
            "tendon_slack_length": ("-1", "11"),
            "pennation_angle_at_optimal": ("-0.1", "5", "\u0661"),
        }.items()
        for value in values
    },
    "huge number": (model(rest="<gravity>0 1e300 0</gravity>"), ("gravity", "1e+30")),
    "impossible inertia": (
        model(body("b", "<mass>1</mass><inertia>1 1 9 0 0 0</inertia>")),
        ('Body "b"', "no solid", "1, 1, 9"),
    ),
    "negative mass": (model(body("b", "<mass>-1</mass>")), ("no solid has the mass -1",)),
    "two bodies of one name": (model(body("b") + body("b")), ('Body "b"', "taken", "line 5")),
    "no name": (model(body("")), ("no component", "'/bodyset/b'")),
    "no joint": (model(body("b") + body("c")), ('Body "c"', "no joint")),
    "closed loop": (
        model(joints=PIN + joint("k", "/ground", "/bodyset/b", coordinate("r"))),
        ('"k"', "'pin'", "closed loop"),
    ),
    "circle": (model(LOOP, CIRCLE), ("circle", "never to the ground")),
    "backwards": (
        model(joints=joint("j", "/bodyset/b", "/ground", coordinate("q"))),
        ('"j"', "its child is the ground"),
    ),
    "unknown frame": (
        model(joints=joint("j", "/ground", "/bodyset/x", coordinate("q"))),
        ("line 9", "no component", "'/bodyset/x'"),
    ),
    "no frame": (
        model(joints='<WeldJoint name="j"><socket_child_frame>b</socket_child_frame></WeldJoint>'),
        ("<socket_parent_frame> is missing",),
    ),
    "a frame that is none": (
        model(joints=PIN + joint("k", "/jointset/pin", "/bodyset/b", coordinate("r"))),
        ("leads to a PinJoint",),
    ),
    "frames in a circle": (
        model(body("b", SELF), joint("j", "/ground", "/bodyset/b/f", coordinate("q"))),
        ("offset from itself",),
    ),
    "joint of another kind": (
        model(joints=joint("j", "/ground", "/bodyset/b", "", kind="EllipsoidJoint")),
        ("EllipsoidJoint", "expected one of", "PinJoint"),
    ),
    "too few coordinates": (
        model(joints=joint("j", "/ground", "/bodyset/b", "", kind="PinJoint")),
        ("expected 1 coordinates, got 0",),
    ),
    "range upside down": (
        model(joints=joint("j", "/ground", "b", coordinate("q", "<range>1 -1</range>"))),
        ('Coordinate "q"', "must not exceed"),
    ),
    "locked perhaps": (
        model(joints=joint("j", "/ground", "b", coordinate("q", "<locked>maybe</locked>"))),
        ("<locked>", "true or false", "'maybe'"),
    ),
    "knots": (
        model(joints=custom_of("<SimmSpline><x>0 0</x><y>0 1</y></SimmSpline>")),
        ("two knots",),
    ),
    "function": (
        model(joints=custom_of("<StepFunction/>")),
        ("StepFunction", "known are Constant, LinearFunction"),
    ),
    "no function": (model(joints=custom_of("")), ('"rotation1"', "function is missing")),
    "idle coordinate": (
        model(joints=custom_of(LINEAR.format("1 0"), "q", "qr")),
        ("'r' moves 0 axes",),
    ),
    "coordinate of another joint": (
        model(joints=custom_of(LINEAR.format("1 0"), "x", "")),
        ("no coordinate of this joint is named 'x'",),
    ),
    "several coordinates": (model(joints=custom_of("<f/>", "q r", "qr")), ("several coordinates",)),
    "moves by itself": (
        model(joints=custom_of(LINEAR.format("1 0"), "", "")),
        ("not constant, but of no coordinate",),
    ),
    "no axis": (
        model(joints=custom(axis("rotation1", "", along="0 0 0"))),
        ("<axis> is missing or has no length",),
    ),
    "unknown axis": (model(joints=custom(axis("rotation4", ""))), ("rotation1",)),
    "twice": (
        model(body("b", "<mass>1</mass><mass>2</mass>")),
        ("<mass> comes twice", "line 5"),
    ),
    "one path point": (
        model(forces=muscle("mus", point("a", "/ground", "0 0 0"))),
        ('"mus"', "at least two path points, got 1"),
    ),
    "two muscles of one name": (
        model(
            forces=muscle("mus", TWO_POINTS),
            rest=f"<components>{muscle('mus', TWO_POINTS)}</components>",
        ),
        ("another muscle",),
    ),
    "a wrap that is none": (
        model(forces=muscle("mus", TWO_POINTS, USE.format(""))),
        ("0 wrap objects are named 'w'",),
    ),
    "wrap range": (
        over("<radius>0.1</radius>", "<range>1 5</range>"),
        ("<range>", "2 points", "1 5"),
    ),
    "wrap range between points": (
        over("<radius>0.1</radius>", "<range>1 1.5</range>"),
        ("<range>", "2 points", "1 1.5"),
    ),
    "wrap radius": (over("<radius>0</radius>"), ("the radius must be positive",)),
    "wrap side": (
        over("<radius>1</radius><quadrant>north</quadrant>"),
        ("<quadrant>", "'north'"),
    ),
    "limit of nothing": (model(forces=limit("x")), ("no coordinate is named 'x'",)),
    "limit of no number": (
        model(
            forces=limit("q")
            .replace("</coo", "</coo", 1)
            .replace("<coo", "<damping>x</damping><coo")
        ),
        ("damping", "expected 1 number", "'x'"),
    ),
    "names that MuJoCo refuses": (
        model(body("world"), PIN.replace("/bodyset/b", "/bodyset/world")),
        ("MuJoCo does not take", "world"),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_bad_file_is_refused_with_its_place_and_reason(case: str, tmp_path: Path) -> None:
    text, fragments = CASES[case]
    with pytest.raises(InputError) as caught:
        import_text(tmp_path, text)
    message = str(caught.value)
    assert "model.osim" in message
    for fragment in fragments:
        assert fragment in message
    assert len(message) < 500
