"""Cases of several people: what a table of them says, what is refused, what comes out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from typer.testing import CliRunner

from cosim.anatomy.case_folder import REPORT
from cosim.anatomy.own_case import OwnFinger, own_finger
from cosim.anatomy.people import LENGTHS, NEEDED, read_people
from cosim.anatomy.user_bones import span, template_of, width_of
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError
from cosim.fingers.chain import build_on_mujoco
from cosim.fingers.common import EQUAL_SHARES, Extensor
from cosim.fingers.kinds import FINGERS
from cosim.measured import measured_of_kind
from cosim.pipeline import run_case
from cosim.results.compare import read_targets
from cosim.study.bands import bands_of
from cosim.study.engine import in_this_process
from cosim.study.execute import execute_study
from cosim.study.plan import read_plan
from cosim.study.sampling import unit_points
from cosim.study.store import Store
from meshes.bones import load_bone
from meshes.skeleton import BODIES
from rigid.model import FingerModel, Via, WrapCylinder, WrapSphere
from tests.helpers.folders import ROOT
from tests.helpers.own_bones import write_surface

HEAD = "subject,finger,hand,proximal_mm,middle_mm,distal_mm"
SHIPPED = ROOT / "cases" / "data" / "people.csv"


def table(path: Path, *rows: str, head: str = HEAD) -> Path:
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def own_row(kind: str, factor: float = 1.0, hand: str = "right") -> str:
    """A finger of our own lengths, times a factor."""
    bones = template_of(kind).bones
    lengths = [repr(1e3 * factor * span(bones[LENGTHS[name]])) for name in NEEDED]
    return ",".join([f"S{kind}", kind, hand, *lengths])


def finger_of(path: Path, *row: str) -> OwnFinger:
    (subject,) = read_people(table(path / "people.csv", *row))
    return own_finger(subject.given)


def model_of(kind: str) -> FingerModel:
    """Our own, with all its tendons."""
    config, make = template_of(kind).config, FINGERS[kind].model
    assert make is not None
    over = make(config, Extensor(lies_on_bones=True))
    return over.with_tendons_of(make(config, Extensor(EQUAL_SHARES)))


@pytest.mark.parametrize(
    ("kind", "factor"),
    [("index", 1.0), ("index", 1.25), ("middle", 0.8), ("ring", 1.0), ("little", 1.25)],
)
def test_our_own_lengths_are_our_finger_and_others_scale_it(
    kind: str, factor: float, tmp_path: Path
):
    """Joints, bones, tendons' points, surfaces that they wrap over, eyelets, and so all arms."""
    finger, ours = finger_of(tmp_path, own_row(kind, factor)), template_of(kind)
    skeleton, exact = finger.joints.skeleton, {"rtol": 0, "atol": 1e-9}
    np.testing.assert_allclose(skeleton.length, factor * ours.skeleton.length, **exact)
    np.testing.assert_allclose(skeleton.axis, ours.skeleton.axis, **exact)
    np.testing.assert_allclose(skeleton.zero, ours.skeleton.zero, **exact)
    assert (finger.size, finger.breadth) == pytest.approx(
        (factor, factor * FINGERS[kind].width(ours.config)), rel=1e-9
    )
    for body, (points, _) in ours.bones.items():
        here = finger.joints.local(body, finger.laid.surfaces[body][0])
        np.testing.assert_allclose(here, factor * points, **exact)
    mine, model = finger.model, model_of(kind)
    assert mine.muscles == model.muscles
    for a, b in zip(mine.tendons, model.tendons, strict=True):
        for at, our in zip(a.strands[0].path, b.strands[0].path, strict=True):
            match at, our:
                case Via(), Via():
                    np.testing.assert_allclose(at.point, factor * np.array(our.point), **exact)
                case ((WrapSphere() | WrapCylinder()), (WrapSphere() | WrapCylinder())):
                    np.testing.assert_allclose(at.radius, factor * our.radius, **exact)
                    np.testing.assert_allclose(at.centre, factor * np.array(our.centre), **exact)
    eyelets = FINGERS[kind].eyelets(ours.config)
    for tendon, at in finger.eyelets.items():
        np.testing.assert_allclose(at, factor * np.array(eyelets[tendon]), **exact)
    arms = [moment_arms(kind, m) for m in (mine, model)]
    np.testing.assert_allclose(arms[0], factor * arms[1], rtol=0, atol=1e-9)


def moment_arms(kind: str, model: FingerModel) -> np.ndarray:
    """By tendon and joint, m, in a bent posture."""
    live = build_on_mujoco(template_of(kind).config, replace(model, meshes={}))
    return np.asarray(live.moment_arms(np.radians([30.0, 5.0, 45.0, 15.0])))


def test_a_left_hand_is_a_right_one_mirrored(tmp_path: Path):
    left, right = (finger_of(tmp_path, own_row("index", 0.9, hand)) for hand in ("left", "right"))
    assert (left.hand, right.hand) == ("left", "right")
    np.testing.assert_array_equal(left.joints.skeleton.axis, right.joints.skeleton.axis)
    assert left.model == right.model


def test_widths_and_the_metacarpal_are_stated_or_follow_the_lengths(tmp_path: Path):
    bones = template_of("index").bones
    row = own_row("index") + f",{2.2e3 * width_of(bones['middle']) / 2:.6f}"
    (subject,) = read_people(table(tmp_path / "a.csv", row, head=f"{HEAD},middle_width_mm"))
    fits = own_finger(subject.given).laid.fits
    np.testing.assert_allclose(fits["middle"].stretch, [1, 1.1, 1.1], rtol=1e-6)
    np.testing.assert_allclose(fits["proximal"].stretch, [1, 1, 1], rtol=1e-6)
    np.testing.assert_allclose(fits["metacarpal"].stretch, [1, 3.1 / 3, 3.1 / 3], rtol=1e-6)


FINE = "A,index,right,41,25,17"


@pytest.mark.parametrize(
    ("rows", "head", "words"),
    [
        ([FINE], HEAD.replace("hand", "side"), "line 1: column hand is missing"),
        ([FINE], HEAD.replace("hand", "side"), "line 1: column side is unknown"),
        (["A,index,right,41,25"], HEAD, "line 2: has 5 cells"),
        (["A,thumb,right,41,25,17"], HEAD, "line 2: finger is 'thumb'; expected one of index,"),
        (["A,index,rihgt,41,25,17"], HEAD, "line 2: hand is 'rihgt'; expected right or left"),
        (["A,index,right,0.041,25,17"], HEAD, "line 2: proximal_mm is 0.041; ours is 40.6 mm"),
        (["A,index,right,0.041,25,17"], HEAD, "Is it in m? Write 41"),
        ([FINE, "a,ring,right,41,25,17"], HEAD, "line 3: subject 'a' is in"),
        (["A,index,right,41,,17"], HEAD, "line 2: middle_mm is empty; write it"),
        (["A,index,,41,25,17"], HEAD, "line 2: hand is empty"),
        ([f"{FINE},-12"], f"{HEAD},proximal_width_mm", "proximal_width_mm is -12; ours is 13.5"),
        (["A,index,right,41,long,17"], HEAD, "line 2: middle_mm is 'long'; expected a finite"),
        (["A,index,right,60,14,17"], HEAD, "these do not belong to one finger"),
        (["7,index,right,41,25,17"], HEAD, "line 2: subject '7': a name begins with a letter"),
        ([f"{FINE},scan"], f"{HEAD},bones", "line 2: proximal_mm and bones are both stated"),
        (["A,index,right,scan"], "subject,finger,hand,bones", "holds none of metacarpal.stl"),
        (["A,index,right,"], "subject,finger,hand,bones", "bones is empty; write a folder"),
        ([], HEAD, "no row follows"),
    ],
)
def test_a_bad_table_is_refused_by_row_and_column(
    rows: list[str], head: str, words: str, tmp_path: Path
):
    path = table(tmp_path / "people.csv", *rows, head=head)
    done = CliRunner().invoke(app, ["new", "all", "--from-table", str(path)])
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())
    assert "Traceback" not in done.output


def test_all_faults_come_at_once_and_other_options_do_not_go_with_a_table(tmp_path: Path):
    path = table(tmp_path / "people.csv", "A,index,up,41,25,17", "B,index,right,41,,-3", FINE)
    with pytest.raises(InputError, match="4 faults") as error:
        read_people(path)
    assert [word in str(error.value) for word in ("hand is 'up'", "middle_mm", "-3", "line 4")]
    words = ["new", "all", "--from-table", str(path), "--finger-kind", "ring"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    assert "--finger-kind: does not go with --from-table" in " ".join(done.output.split())


def test_a_folder_of_bones_takes_the_place_of_lengths(tmp_path: Path):
    (tmp_path / "scan").mkdir()
    surface = load_bone("middle").surface(0.8e-3)
    write_surface(surface, tmp_path / "scan" / "middle.stl")
    row = "A,index,right,,,,scan"
    (subject,) = read_people(table(tmp_path / "p.csv", row, head=f"{HEAD},bones"))
    assert subject.given.bones == {"middle": tmp_path / "scan" / "middle.stl"}
    assert subject.given.sizes == {}


def test_the_shipped_people_are_those_of_the_ten_hands():
    """Means and SDs of the source, 45 % of the variance in common, by our own Latin hypercube."""
    rows = [
        m for m in measured_of_kind("length", finger="index") if m.cited.source == "munyebvu2024"
    ]
    mean, sd = np.array([r.value for r in rows]), np.array([r.sd for r in rows])
    z = norm.ppf(unit_points("latin_hypercube", 4, 20, 1, False))
    lengths = mean + sd * (np.sqrt(0.45) * z[:, :1] + np.sqrt(0.55) * z[:, 1:])
    sizes = [[subject.given.sizes[body] for body in BODIES[1:]] for subject in read_people(SHIPPED)]
    np.testing.assert_allclose(1e3 * np.array(sizes)[:, :, 0], lengths, atol=0.00501)
    np.testing.assert_allclose(
        np.array(sizes)[:, :, 1] / np.array(sizes)[:, :, 0],
        [np.array([16.2, 12.4, 9.3]) / mean] * 20,
        rtol=1e-3,
    )


def test_a_case_is_laid_over_another_than_it_says():
    case = load_case("isometric_edc", ["extends=base/split.toml"])
    assert (case.hood.kind, case.tendons["EDC"].activation) == ("split", 0.1)
    with pytest.raises(InputError, match="no such file"):
        load_case("isometric_edc", ["extends=nowhere.toml"])


def test_bands_over_people_beside_those_of_the_inputs(tmp_path: Path):
    """Percentiles over a list's values, where nothing is sampled; and read again as targets."""
    for name, activation in (("a", 0.1), ("b", 0.2), ("c", 0.3)):
        base = f'extends = "split_edc"\n[tendons]\nLUM = {{ activation = {activation} }}\n'
        (tmp_path / f"{name}.toml").write_text(base)
    (tmp_path / "load.toml").write_text('extends = "split_edc"\ntitle = "load"\n')
    study = tmp_path / "three.toml"
    study.write_text(
        'case = "load.toml"\nbands = true\n[parameters.subject]\nvalues = ["a", "b", "c"]\n'
        'settings = ["extends={value}.toml"]\n[outputs]\nforce = "fingertip_magnitude_N"\n'
    )
    plan, store = read_plan(study), Store(tmp_path / "store").open()
    done = execute_study(plan, store, in_this_process, False, lambda count: None)
    bands = bands_of(plan, done, store)
    bands.to_csv(tmp_path / "bands.csv", index=False)
    (force,) = [row for row in bands.itertuples() if row.quantity == "fingertip_magnitude_N"]
    each = [run_case(load_case(tmp_path / f"{n}.toml")).summary for n in "abc"]
    values = [summary["fingertip_magnitude_N"] for summary in each]
    assert (force.p5, force.p95) == pytest.approx(tuple(np.percentile(values, [5, 95])), rel=1e-9)
    own = run_case(load_case("split_edc")).summary["fingertip_magnitude_N"]
    assert force.as_it_is == pytest.approx(own, rel=1e-9)
    (target,) = [t for t in read_targets(tmp_path / "bands.csv") if t.quantity == force.quantity]
    assert (target.low, target.reference, target.high) == (force.p5, force.p50, force.p95)
    assert (target.kind, target.n, target.unit) == ("inferred", 3, "N")


@pytest.mark.slow
def test_people_are_made_and_run_as_a_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Our own lengths give our finger's force; the other is another."""
    monkeypatch.chdir(tmp_path)
    other = "B,index,left,44,25,17"
    path = table(tmp_path / "people.csv", own_row("index"), other)
    done = CliRunner().invoke(app, ["new", "two", "--from-table", str(path)])
    assert done.exit_code == 0, done.output
    assert len((tmp_path / "two" / REPORT).read_text().splitlines()) == 2
    ours, same, longer = (
        run_case(load_case(tmp_path / "two" / "load.toml", [*base, "output.picture=false"])).summary
        for base in ([], ["extends=Sindex/Sindex.toml"], ["extends=B/B.toml"])
    )
    assert same["fingertip_magnitude_N"] == pytest.approx(ours["fingertip_magnitude_N"], rel=1e-5)
    assert longer["moment_arm_mm"]["EDC"]["MCP"] < 1.05 * ours["moment_arm_mm"]["EDC"]["MCP"]
    done = CliRunner().invoke(app, ["study", "two/two.toml", "--workers", "0"])
    assert done.exit_code == 0, done.output
    assert "bands by two" in done.output
