"""What goes together in a case, and what pictures show of it."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.models.build import build
from cosim.models.fit import check_fit


def test_fingers_without_bones_of_their_own_are_drawn_as_rods():
    """From joint to joint, to half a radius or so; the fixed one proximal of the MCP."""
    bones = build(load_case("planar_edc")).bones
    assert list(bones) == ["metacarpal", "proximal", "middle", "distal"]
    for body, (low, high, radius) in {
        "metacarpal": (-40, 0, 4.1),
        "proximal": (0, 46, 3.9),
        "distal": (0, 20, 2.0),
    }.items():
        vertices, faces = bones[body]
        side = 1e3 * np.abs(vertices[:, 1:]).max()  # of a polygon, which trimesh turns as it likes
        assert side == pytest.approx(radius, rel=0.01)
        ends = 1e3 * vertices[:, 0].min(), 1e3 * vertices[:, 0].max()
        assert ends == pytest.approx((low - radius, high + radius))
        assert faces.max() == len(vertices) - 1


@pytest.mark.parametrize(
    ("name", "tendon", "words"),
    [
        ("split_edc", 'tendons.RI.tension="2 N"', r"tendons\.RI: .*EDC, EI, LUM, FPI, FDP, FDS"),
        ("middle_minorflex_fdp", 'tendons.EI.tension="2 N"', r"tendons\.EI: .*RI, UI"),
        ("planar_edc", 'tendons.FDP.tension="2 N"', r"tendons\.FDP: .*they have EDC$"),
        ("forward_edc", 'tendons.RI={max_force="9 N",activation=1.0}', r"tendons\.RI: .*FPI"),
        (
            "forward_edc",
            'tendons.UI.signal={kind="points",at=[["0 s",1.0]]}',
            r"tendons\.UI: .*FPI",
        ),
    ],
)
def test_a_tendon_that_the_finger_lacks_is_refused_before_anything_runs(name, tendon, words):
    with pytest.raises(InputError, match=words):
        check_fit(load_case(name, [tendon]))


def test_a_tendon_that_the_finger_lacks_may_have_a_greatest_force():
    check_fit(load_case("planar_edc", ['tendons.FDP.max_force="9 N"']))


def test_a_course_file_is_read_before_anything_runs(tmp_path):
    path = tmp_path / "pull.csv"
    path.write_text("time,EDC\n0,1\n0,2\n")
    signal = f'tendons.EDC.signal={{kind="file",path="{path.as_posix()}",column="EDC"}}'
    with pytest.raises(InputError, match="times that rise"):
        check_fit(load_case("forward_edc", [signal]))


def test_a_pulley_hood_s_cables_are_drawn_where_they_run():
    case = load_case("pulley_edc", ["output.picture=false"])
    models = build(case)
    motion = models.finger.motion(models.finger.start(models.posture))
    strings = models.lines(motion)
    assert list(strings) == [f"{name} cable" for name in models.hood.tendons]
    position, rotation = motion.of("proximal")
    point = case.hood.paths["EDC"][1].point
    np.testing.assert_allclose(strings["EDC cable"][1], position + rotation @ point)
