"""Joint angles from markers over time."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from cosim.analyses.estimate.markers import read_any_motion, read_seen_motion
from cosim.cli import app
from cosim.errors import InputError
from meshes.skeleton import index_finger
from rigid.chain.pose import BodyMarkers
from rigid.fingers.index import finger_model
from rigid.mujoco.finger import MujocoFinger
from rigid.opensim.sto import read_trc

FINGER = MujocoFinger(finger_model(index_finger()))
PLACES = {
    "wrist": ("metacarpal", (-50, 5, 8)),
    "hand_radial": ("metacarpal", (-20, 12, 8)),
    "hand_ulnar": ("metacarpal", (-20, -10, 9)),
    "knuckle": ("metacarpal", (-8, 1, 12)),
    "proximal_1": ("proximal", (15, 5, 9)),
    "proximal_2": ("proximal", (32, -3, 8)),
    "middle_1": ("middle", (50, 4, 7)),
    "middle_2": ("middle", (60, -3, 6)),
    "nail": ("distal", (80, 1, 5)),
}
"""Body, and place on the straight finger, mm."""
TIME = np.linspace(0.0, 1.0, 11)
ANGLE = np.column_stack(
    [0.2 + 0.6 * TIME, 0.1 * np.sin(3 * TIME), 0.3 + 0.9 * TIME**2, 0.1 + 0.4 * TIME]
)
LAB = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix(), np.array([0.7, -0.2, 1.1])
"""How the laboratory sees the finger's world; the hand drifts by 3 cm over the trial."""


def table(tmp_path, left_out=()):
    path = tmp_path / "markers.csv"
    rows = [
        f"{name},{body},{','.join(map(str, place))}\n"
        for name, (body, place) in PLACES.items()
        if name not in left_out
    ]
    path.write_text("name,body,distal_mm,radial_mm,dorsal_mm\n" + "".join(rows))
    return path


def trial(tmp_path, gaps=(), noise=0.0, unit="mm"):
    """A .trc of the motion; `gaps` are (frame, marker)."""
    body = np.array([FINGER.bodies.index(b) for b, _ in PLACES.values()])
    straight = FINGER.chain(np.zeros(4)).motion
    away = 1e-3 * np.array([p for _, p in PLACES.values()]) - straight.position[body]
    glued = BodyMarkers(body, np.einsum("mji,mj->mi", straight.rotation[body], away))
    rng, rows = np.random.default_rng(3), []
    for k, (time, angle) in enumerate(zip(TIME, ANGLE, strict=True)):
        seen = glued.at(FINGER, angle)[0] @ LAB[0].T + LAB[1] + [0.03 * time, 0, 0]
        seen = (seen + rng.normal(0, noise, seen.shape)) * {"mm": 1e3, "m": 1.0}[unit]
        cells = [
            "\t\t" if (k, name) in gaps else "\t".join(f"{x:.9f}" for x in place)
            for name, place in zip(PLACES, seen, strict=True)
        ]
        rows.append(f"{k + 1}\t{time:.3f}\t" + "\t".join(cells) + "\t\n")
    path = tmp_path / "trial.trc"
    axes = "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(PLACES) + 1))
    path.write_text(
        "PathFileType\t4\t(X/Y/Z)\ttrial.trc\n"
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\n"
        f"10\t10\t{len(TIME)}\t{len(PLACES)}\t{unit}\t10\n"
        "Frame#\tTime\t" + "\t\t\t".join(PLACES) + "\t\t\n"
        f"\t\t{axes}\t\n\n" + "".join(rows)
    )
    return path


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_the_angles_are_those_that_moved_the_markers(tmp_path, unit):
    seen = read_seen_motion(trial(tmp_path, unit=unit), table(tmp_path), FINGER, {})
    assert seen.time == pytest.approx(TIME)
    assert seen.angle == pytest.approx(ANGLE, abs=2e-5)
    assert seen.miss.max() < 1e-6


def test_the_miss_is_the_noise_of_the_cameras(tmp_path):
    seen = read_seen_motion(trial(tmp_path, noise=3e-4), table(tmp_path), FINGER, {})
    assert 1e-4 < seen.miss.mean() < 6e-4
    assert np.abs(seen.angle - ANGLE).max() < 0.1


def test_gaps_that_leave_enough_are_bridged(tmp_path):
    gaps = [(3, "wrist"), (5, "proximal_1"), (7, "middle_2")]
    seen = read_seen_motion(trial(tmp_path, gaps), table(tmp_path), FINGER, {})
    assert seen.angle == pytest.approx(ANGLE, abs=2e-5)


def test_a_joint_that_no_marker_shows_stays_in_its_posture(tmp_path):
    seen = read_seen_motion(trial(tmp_path), table(tmp_path, ["nail"]), FINGER, {"DIP": 0.25})
    assert seen.angle[:, 3] == pytest.approx(0.25)
    assert seen.angle[:, :3] == pytest.approx(ANGLE[:, :3], abs=2e-5)


@pytest.mark.parametrize(
    ("gaps", "left_out", "said"),
    [
        ([(4, "nail")], (), r"0\.4 s: the 4 markers .* tell 3 of 4 angles apart"),
        ([(4, "wrist"), (4, "knuckle")], (), r"0\.4 s: 2 markers of the first body are seen"),
        ([], ["wrist", "knuckle"], r"0 s: 2 markers of the first body"),
    ],
)
def test_too_few_markers_are_told_with_the_time(tmp_path, gaps, left_out, said):
    with pytest.raises(InputError, match=said):
        read_seen_motion(trial(tmp_path, gaps), table(tmp_path, left_out), FINGER, {})


@pytest.mark.filterwarnings("ignore:.*left out")
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("nail,distal", "nail,distal_phalanx", "line 10: body is 'distal_phalanx'; expected one"),
        ("name,body", "name,part", "line 2: body is ''; expected one of metacarpal"),
    ],
)
def test_a_bad_table_of_markers_is_refused(tmp_path, old, new, said):
    path = table(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=said):
        read_seen_motion(trial(tmp_path), path, FINGER, {})


def test_markers_that_the_trial_has_not_are_told(tmp_path):
    path = table(tmp_path)
    path.write_text(path.read_text().replace("knuckle,", "knukle,"))
    with pytest.warns(UserWarning, match="the trial has no marker knukle"):
        read_seen_motion(trial(tmp_path), path, FINGER, {})
    head, row, *_ = path.read_text().splitlines()
    path.write_text(f"{head}\n{row.replace('wrist', 'wirst')}\n")
    with pytest.raises(InputError, match="none of its markers; it has wrist"):
        read_seen_motion(trial(tmp_path), path, FINGER, {})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("PathFileType", "Path", "is no .trc"),
        ("\tmm\t", "\tinch\t", "line 3: Units is 'inch'; expected one of mm, cm, m"),
        ("\twrist\t", "\tnail\t", "line 4: names nail twice"),
        ("\n3\t0.200", "\n3\t0.100", r"time must rise; 0\.1 s is followed by 0\.1 s"),
        ("\n3\t0.200\t", "\n3\t0.200\tlost\t", "line 9: "),
        ("\n3\t0.200", "\n3\t", "line 9: expected a time"),
        ("\n3\t0.200\t", "\n3\t1_0\t", "line 9: '1_0' is no number"),
    ],
)
def test_a_bad_trial_is_refused_with_its_line(tmp_path, old, new, said):
    path = trial(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=said):
        read_trc(path)


@given(st.text(alphabet="0123456789.\tnaeif-\n ", max_size=60))
def test_any_rows_are_read_or_refused(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("trc") / "t.trc"
    head = "PathFileType\t4\nUnits\nmm\nFrame#\tTime\ta\t\t\n\t\tX1\tY1\tZ1\n"
    path.write_text(head + rows)
    try:
        motion = read_trc(path)
    except InputError:
        return
    assert motion.place.shape == (len(motion.time), 1, 3)
    assert (np.diff(motion.time) > 0).all()


def test_the_command_estimates_tensions_from_markers(tmp_path):
    words = ["estimate", "split_edc", "--motion", trial(tmp_path), "--samples", "4"]
    words += ["--markers", table(tmp_path), "--reserve", "1 N*m", "-o", tmp_path]
    done = CliRunner().invoke(app, [*map(str, words)])
    assert done.exit_code == 0, done.output
    assert "mm off the finger's in the mean" in done.output
    told = json.loads((tmp_path / "split_edc" / "estimate.json").read_text())
    assert told["audit"]["markers_miss_mm"] < 1e-3
    for lone in (words[:6], [*words[:2], *words[6:]]):
        assert CliRunner().invoke(app, [*map(str, lone)]).exit_code == 2


def test_markers_that_are_not_on_the_finger_are_refused(tmp_path):
    """A .trc whose unit is wrong: the finger is a thousand times as large."""
    path = trial(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace("\tmm\t", "\tm\t"), encoding="utf-8")
    with pytest.raises(InputError, match=r"mm off those of .* Is the unit of both right"):
        read_any_motion(path, table(tmp_path), FINGER, {}, None, None, lambda text: None)
