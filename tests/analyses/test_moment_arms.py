"""`cosim moment-arms`, and fingers that `cosim export` writes for MuJoCo."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas
import pytest
from typer.testing import CliRunner

from cosim.analyses.moment_arms import (
    by_posture,
    compare_published,
    draw,
    native_arms,
    published_arms,
    sweep,
)
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import ConvergenceError
from cosim.fingers.kinds import joint_ranges
from cosim.models.build import build, tensions
from cosim.port import Motion


def test_a_sweep_holds_every_tendon_joint_and_posture() -> None:
    case = load_case("split_edc")
    models = build(case)
    table, lost = sweep(models, np.zeros(0), models.finger.ranges, 3)
    assert lost == []
    assert len(table) == 4 * 3 * 8
    fdp = table[(table.tendon == "FDP") & (table.joint == "DIP")]
    assert fdp.angle_deg.tolist() == pytest.approx([0, 35, 70])
    home = native_arms(models, {**models.posture, "DIP": np.radians(35)})["FDP"]
    assert fdp.arm_mm.tolist()[1] == pytest.approx(1e3 * home[3])


def test_cables_over_a_hood_have_the_arms_of_their_run() -> None:
    """The pulley hood: d torque / d tension in the sweep is what the run's summary says."""
    from cosim.pipeline import run_case

    case = load_case("pulley_edc", ["output.picture=false"])
    models = build(case)
    summary = run_case(case).summary
    posture = {k: np.radians(v) for k, v in summary["posture_deg"].items()}
    tension, _ = tensions(case, models)
    at = {j: (posture[j], posture[j] + 1e-9) for j in ("PIP",)}
    object.__setattr__(models, "posture", posture)
    table, lost = sweep(models, tension, at, 2)
    arm = table[(table.tendon == "EDC") & (table.joint == "PIP")].arm_mm.iloc[0]
    assert lost == []
    assert arm == pytest.approx(summary["moment_arm_mm"]["EDC"]["PIP"], rel=1e-6)


@pytest.mark.parametrize(
    ("finger", "name"), [("index", "split_edc"), ("middle", "middle_minorflex_edc")]
)
def test_published_arms_have_a_source_and_stand_beside_the_model_s(finger: str, name: str) -> None:
    known = published_arms(finger)
    assert known.source.str.len().min() > 3
    assert set(known.joint) <= {"MCP", "MCP_abduction", "PIP", "DIP"}
    for joint, angles in {"MCP": (0, 30, 60, 80), "PIP": (0, 45, 90), "DIP": (0, 45, 70)}.items():
        at = {"/".join(str(a * (j == joint)) for j in ("MCP", "PIP", "DIP")) for a in angles}
        for source in ("MyoHand", "An et al. 1979, straight line"):
            assert at <= set(known[(known.joint == joint) & (known.source == source)].posture_deg)
    compared = compare_published(build(load_case(name)), known)
    assert len(compared) == len(known)
    apart = (compared.model_mm - compared.arm_mm).abs()
    assert np.median(apart) < 2.0
    flexes = compared[compared.joint != "MCP_abduction"]
    other = flexes[np.sign(flexes.model_mm) != np.sign(flexes.arm_mm)]
    # MyoHand's ulnar interosseous is palmar of the flexed PIP's axis.
    assert set(zip(other.tendon, other.joint, other.posture_deg, strict=True)) <= {
        ("UI", "PIP", "0/90/0")
    }


def test_our_paths_are_ans_lines_but_where_something_holds_them() -> None:
    """At the MCP of the intrinsics everywhere, of the other tendons in the straight finger."""
    for finger, name in (("index", "split_edc"), ("middle", "middle_minorflex_edc")):
        known = published_arms(finger)
        known = known[known.source.str.startswith("An et al. 1979") & (known.joint == "MCP")]
        compared = compare_published(build(load_case(name)), known).set_index("tendon")
        apart = (compared.model_mm - compared.arm_mm).abs()
        intrinsic = [t for t in ("FDIm", "LUM", "FPI", "UI") if t in apart.index]
        assert apart.loc[intrinsic].max() < 0.5
        assert apart[compared.posture_deg == "0/0/0"].drop("RI", errors="ignore").max() < 0.2
        if finger == "middle":  # An's point for it is doubted
            assert apart.loc["RI"].min() > 2.5


def test_a_table_has_the_model_first_and_a_range_last() -> None:
    known = published_arms("index")
    wide = by_posture(compare_published(build(load_case("split_edc")), known))["DIP"]
    sources = [source for tendon, source in wide.index if tendon == "FDP"]
    assert sources[0] == "model"
    assert set(sources) > {"MyoHand", "ARMS hand model", "Ketchum et al. 1978"}
    assert list(wide.columns) == ["0/0/0", "0/0/45", "0/0/70", "30/45/15", "range"]
    assert wide.loc[("FDP", "An et al. 1983, J Biomech 16:419-425"), "range"] == 4.1


def test_the_command_leaves_a_table_a_comparison_and_a_plot(tmp_path: Path) -> None:
    out = tmp_path / "arms"
    words = ["moment-arms", "split_edc", "--steps", "3", "--out", str(out)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert sorted(p.name for p in out.iterdir()) == [
        "moment_arms.csv",
        "moment_arms.png",
        "published.csv",
    ]
    assert len(pandas.read_csv(out / "moment_arms.csv")) == 4 * 3 * 8
    assert "An et al. 1983" in done.output


def test_published_arms_are_drawn_where_they_belong() -> None:
    """FDP at the DIP in the posture 30/45/15: a point at 15 deg, and means from 0 deg on."""
    models = build(load_case("split_edc"))
    table, _ = sweep(models, np.zeros(0), {"DIP": (0.1, 1.2)}, 3)
    fdp = table[table.tendon == "FDP"]
    known = published_arms("index")
    axes = draw(fdp, "", known, models.posture).axes[0]
    points = [line.get_xydata() for line in axes.lines if line.get_marker() == "o"]
    assert np.ravel(points) == pytest.approx([15.0, 4.99])
    means = [path for c in axes.collections for path in c.get_paths()]  # type: ignore[attr-defined]
    assert sorted(path.vertices[0, 1] for path in means) == pytest.approx([4.05, 4.1, 6.5])
    assert all(path.vertices[0, 0] == 0.0 for path in means)
    bare = draw(fdp, "", published_arms("hinge"), models.posture).axes[0]
    assert not bare.collections
    assert len(bare.lines) == 2


@pytest.mark.parametrize("finger", ["planar", "hinge"])
def test_a_finger_without_ranges_is_swept_over_those_of_a_posture(finger: str) -> None:
    hinge = (
        'finger={kind="hinge",lengths=["46 mm","28 mm","20 mm"],'
        'posture={MCP="0 deg",PIP="20 deg",DIP="10 deg"}}'
    )
    case = load_case("planar_edc", [hinge] if finger == "hinge" else [])
    ranges = joint_ranges(build(case).finger)
    assert {j: tuple(np.degrees(r)) for j, r in ranges.items()} == {
        "MCP": pytest.approx((-30, 90)),
        "PIP": pytest.approx((0, 110)),
        "DIP": pytest.approx((0, 70)),
    }


def test_where_the_hood_is_lost_is_said_with_its_direction() -> None:
    case = load_case("pulley_edc")
    models = build(case)

    class Lost:
        tendons = models.hood.tendons

        def start(self, motion: Motion) -> None:
            return None

        def advance(self, *_: object) -> None:
            raise ConvergenceError("no equilibrium")

    object.__setattr__(models.built, "hood", Lost())
    tension, _ = tensions(case, models)
    _, lost = sweep(models, tension, {"PIP": (0.0, 1.5)}, 3)
    assert [text.split(":")[0] for text in lost] == [
        "PIP from 45 towards 86 deg",
        "PIP from 45 towards 0 deg",
    ]


def test_a_folder_that_cannot_be_made_is_one_message(tmp_path: Path) -> None:
    file = tmp_path / "in the way"
    file.touch()
    done = CliRunner().invoke(app, ["moment-arms", "split_edc", "--out", str(file)])
    assert done.exit_code == 2
    assert "cannot be written" in done.stderr


def test_mjcf_opens_in_mujoco_and_has_the_case_s_finger(tmp_path: Path) -> None:
    out = tmp_path / "finger.xml"
    assert CliRunner().invoke(app, ["export", "split_edc", "--out", str(out)]).exit_code == 0
    model = mujoco.MjModel.from_xml_path(str(out))
    assert (model.nq, model.ntendon) == (4, 8)
    (taken := tmp_path / "folder.xml").mkdir()
    folder = CliRunner().invoke(app, ["export", "split_edc", "--out", str(taken)])
    assert folder.exit_code == 2
    assert "is no file" in folder.stderr
    words = ["export", "pulley_edc", "--set", "finger.kind=hinge", "--out", str(out)]
    hinge = CliRunner().invoke(app, words)
    assert hinge.exit_code == 2


def test_a_mean_over_a_joint_without_range_is_over_that_of_a_finger(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    models = build(load_case("split_edc"))
    known = published_arms("index")
    known = known[known.posture_deg == "range"].head(2)
    stated = compare_published(models, known).model_mm
    endless = dict.fromkeys(models.finger.joints, (-np.inf, np.inf))
    monkeypatch.setattr(models.finger, "ranges", endless)
    assert compare_published(models, known).model_mm.tolist() == pytest.approx(stated.tolist())
