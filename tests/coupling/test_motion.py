"""Coupled motions of cases: schemes, books, rest, checkpoints."""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

import cosim
from cosim.case.file import load_case, resolved_toml
from cosim.cli import app
from cosim.coupling.checkpoint import NAME
from cosim.coupling.motion import CoupledMotion, MotionState
from cosim.errors import ConvergenceError, InputError, StoppedError
from cosim.files import shown_path
from cosim.models.motion import moving_models
from cosim.pipeline import run_case
from cosim.results.motion import _largest_of_hood
from cosim.results.result import Result
from cosim.solve import motion as run_motion
from cosim.solve.session import Session
from meshes.skeleton import BODIES
from tests.helpers.motions import FREE, HELD, PLAIN, Stopper, identical, work_done, work_kept

SHORT = 'forward={duration="0.06 s",must_rest=false}'
ADVANCE = CoupledMotion.advance
SHORTER = SHORT.replace("0.06", "0.04")


def run_motion_case(*settings: str, name: str = "pulley_edc") -> Result:
    return run_case(load_case(name, [PLAIN, *settings]))


def test_iterated_schemes_make_the_same_motion_and_linear_nearly() -> None:
    by_scheme = {
        scheme: run_motion_case(*FREE, SHORTER, f"coupling={setting}").data.angle.values
        for scheme, setting in {
            "newton": "{scheme='newton'}",
            "aitken": "{scheme='implicit'}",
            "iqn": "{scheme='implicit',accelerator='iqn_ils'}",
            "linear": "{scheme='linear'}",
            "explicit": "{scheme='explicit'}",
        }.items()
    }
    newton = by_scheme.pop("newton")
    assert np.ptp(newton, axis=0).max() > 0.02  # it moves
    miss = {scheme: np.abs(a - newton).max() for scheme, a in by_scheme.items()}
    assert miss["aitken"] < 1e-7
    assert miss["iqn"] < 1e-7
    assert miss["linear"] < 1e-4
    assert miss["linear"] < miss["explicit"] < 5e-2


def test_the_books_close_on_every_body_at_every_step() -> None:
    result = run_motion_case(*FREE, SHORT, 'finger.gravity=["0 m/s**2","0 m/s**2","-9.81 m/s**2"]')
    times = {row.state for row in result.rows}
    assert len(times) == 60
    for time in times:
        for body in BODIES:
            here = [row for row in result.rows if (row.state, row.body) == (time, body)]
            held = {"ground"} if body == BODIES[0] else {"inertia", "gravity"}
            assert {"joint", *held} <= {row.source for row in here}
            largest = max(np.linalg.norm(row.force) for row in here)
            assert np.linalg.norm(sum(row.force for row in here)) < 1e-9 * largest
            moment = max(np.linalg.norm(row.moment) for row in here)
            assert np.linalg.norm(sum(row.moment for row in here)) < 1e-9 * moment
    assert result.summary["audit"]["hood_force_balance"] < 1e-9


def test_joints_carry_little_moment_about_their_axes() -> None:
    """What closes the books is no more than the step's own error: less at smaller steps."""
    off = []
    for step in ("1 ms", "0.25 ms"):
        forward = f'forward={{duration="0.02 s",step="{step}",must_rest=false}}'
        result = run_motion_case(*FREE, forward, name="planar_edc")
        last = "0.02 s"
        joint = [r for r in result.rows if r.state == last and r.source == "joint"]
        (distal,) = [row.moment for row in joint if row.body == "distal"]
        off.append(abs(distal[1]))
    assert off[1] < 0.5 * off[0]


def test_energy_is_accounted_for_and_the_method_takes_less_at_smaller_steps() -> None:
    taken = []
    for step in ("1 ms", "0.25 ms"):
        forward = f'forward={{duration="0.03 s",step="{step}",must_rest=false}}'
        summary = run_motion_case(*FREE, forward).summary
        e = summary["energy_mJ"]
        assert work_done(e) == pytest.approx(work_kept(e), rel=1e-9)
        taken.append(abs(e["artificial"]))
    assert taken[1] < 0.4 * taken[0]


def test_what_a_device_and_friction_take_of_each_step_adds_up(monkeypatch) -> None:
    case = load_case("pulley_edc", [PLAIN, *FREE, SHORT])
    assert case.forward is not None
    models = moving_models(case, case.forward)
    at, taken = models.moves.begin(models.initial_state), iter([1.0, 2.0, 4.0])
    monkeypatch.setattr(type(models.finger), "device_loss", lambda *_: next(taken))
    monkeypatch.setattr(type(models.finger), "friction_work", lambda *_: np.array([1.0, 0, 3]))
    found = []
    for _ in range(3):
        at = models.moves.advance(at)
        found.append(at.slipped)
    assert found == [1.0, 3.0, 7.0]
    assert at.friction.tolist() == [3.0, 0.0, 9.0]


@pytest.mark.slow
def test_a_held_motion_ends_in_the_equilibrium() -> None:
    still = run_motion_case(*HELD).summary
    run = run_motion_case(*HELD, 'forward={duration="1 s"}').summary
    assert run["fingertip_force_N"] == pytest.approx(still["fingertip_force_N"], abs=1e-4)
    for joint, angle in still["posture_deg"].items():
        assert run["posture_deg"][joint] == pytest.approx(angle, abs=1e-2)


def test_a_finger_that_still_moves_misses_its_audit() -> None:
    run = run_motion_case(*FREE, 'forward={duration="0.12 s"}')
    assert run.audit.missed == ("at_rest",)


def cut_off(case: Any, folder: Path, words: int) -> None:
    with pytest.raises(StoppedError, match="Go on with: cosim run --resume"):
        run_case(case, Session(checkpoints=folder), Stopper(words))


LONG = 'forward={duration="0.1 s",must_rest=false,checkpoint=15}'


@pytest.mark.parametrize("scheme", ["linear", pytest.param("implicit", marks=pytest.mark.slow)])
def test_a_motion_that_was_cut_off_goes_on_to_the_same_bytes(tmp_path: Path, scheme: str) -> None:
    fibre = (
        'tendons.EDC.muscle={kind="millard",optimal_fibre_length="70 mm",'
        'tendon_slack_length="264.68 mm"}'
    )
    case = load_case("pulley_edc", [PLAIN, *FREE, LONG, fibre, f"coupling.scheme='{scheme}'"])
    whole = run_case(case)
    for words in (1, 1):  # stopped, gone on with, stopped again
        cut_off(case, tmp_path, words)
    gone = run_case(case, Session(checkpoints=tmp_path))
    assert identical(whole, gone)
    assert gone.summary["iterations"] == whole.summary["iterations"]


def test_checkpoints_are_kept_though_none_were_asked_for(tmp_path: Path, monkeypatch) -> None:
    case = load_case("pulley_edc", [PLAIN, *FREE, SHORT])
    whole = run_case(case)
    cut_off(case, tmp_path / "stopped", 1)
    assert identical(whole, run_case(case, Session(checkpoints=tmp_path / "stopped")))
    monkeypatch.setattr(run_motion, "PAUSE", -1.0)
    written: list[Path] = []
    monkeypatch.setattr(run_motion, "write_checkpoint", lambda folder, *_: written.append(folder))
    assert identical(whole, run_case(case, Session(checkpoints=tmp_path / "killed")))
    assert len(written) == 60


def test_a_motion_that_wants_no_checkpoints_keeps_none(tmp_path: Path) -> None:
    forward = 'forward={duration="0.06 s",must_rest=false,checkpoint=0}'
    case = load_case("pulley_edc", [PLAIN, *FREE, forward])
    with pytest.raises(KeyboardInterrupt):
        run_case(case, Session(checkpoints=tmp_path), Stopper(1))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_hood_whose_state_cannot_be_written_says_so_and_moves(tmp_path: Path) -> None:
    forward = 'forward={duration="0.002 s",must_rest=false}'
    rough = (PLAIN, *FREE, forward, "hood.mesh.quads=120", "hood.contact.friction=0.1")
    said: list[str] = []
    run_case(load_case("isometric_edc", rough), Session(checkpoints=tmp_path), said.append)
    assert [text for text in said if "keeps no checkpoints" in text and "augmented" in text]
    asked = [*rough, "forward.checkpoint=1"]
    with pytest.raises(InputError, match="has no checkpoints; leave one of the two out"):
        run_case(load_case("isometric_edc", asked), Session(checkpoints=tmp_path))


@pytest.mark.slow
def test_a_shell_hood_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    forward = 'forward={duration="0.03 s",must_rest=false,checkpoint=12}'
    case = load_case("isometric_edc", [PLAIN, *FREE, forward, "hood.mesh.quads=120"])
    whole = run_case(case)
    cut_off(case, tmp_path, 1)
    assert identical(whole, run_case(case, Session(checkpoints=tmp_path)))


def test_a_checkpoint_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    case = load_case("pulley_edc", [PLAIN, *FREE, LONG])
    cut_off(case, tmp_path, 1)
    file = tmp_path / "pulley_edc.unfinished" / NAME
    good = file.read_bytes()
    other = load_case("pulley_edc", [PLAIN, *FREE, LONG, "tendons.EDC.activation=0.2"])
    (file.parent / "case.toml").write_text(resolved_toml(other), encoding="utf-8")
    with pytest.raises(InputError, match="belongs to another case"):
        run_case(other, Session(checkpoints=tmp_path))
    (file.parent / "case.toml").write_text(resolved_toml(case), encoding="utf-8")
    for size in (0, 100, len(good) // 2, len(good) - 10):
        file.write_bytes(good[:size])
        with pytest.raises(InputError, match="is no whole checkpoint"):
            run_case(case, Session(checkpoints=tmp_path))
    np.savez(file.open("wb"), object=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="is no whole checkpoint"):
        run_case(case, Session(checkpoints=tmp_path))
    for spoilt, reason in spoilt_checkpoints(good):
        file.write_bytes(spoilt)
        with pytest.raises(InputError, match=f"is no whole checkpoint \\(.*{reason}"):
            run_case(case, Session(checkpoints=tmp_path))
    file.write_bytes(good)
    run_case(case, Session(checkpoints=tmp_path))


def spoilt_checkpoints(good: bytes) -> Iterator[tuple[bytes, str]]:
    """The archive with other arrays, and packed in other ways, and what is said of each."""
    with np.load(BytesIO(good)) as file:
        arrays = {name: file[name] for name in file.files}
    for name in ("state/coupled/time", "frames/angles"):
        yield archive_of({**arrays, name: arrays[name] + 1e300}), "changed after"
    yield archive_of({k: v for k, v in arrays.items() if k != "digest"}), "changed after"
    for kind in (zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2):
        yield archive_of(arrays, kind), "packed"
    shape = re.search(rb"\(\d+, \d+\), ", good)
    assert shape is not None
    yield good.replace(shape.group(), (b"(%d,), " % 10**11).ljust(len(shape.group()))), ""


def archive_of(arrays: Mapping[str, Any], kind: int = zipfile.ZIP_STORED) -> bytes:
    content = BytesIO()
    with zipfile.ZipFile(content, "w", kind) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, np.asarray(array))
    return content.getvalue()


def test_another_case_s_checkpoint_is_never_removed(tmp_path: Path) -> None:
    case = load_case("pulley_edc", [PLAIN, *FREE, LONG])
    cut_off(case, tmp_path, 1)
    file = tmp_path / "pulley_edc.unfinished" / NAME
    kept = file.read_bytes()
    other = load_case("pulley_edc", [PLAIN, *FREE, LONG, "output.frames=10"])
    with pytest.raises(InputError, match="a part of a run of another case of this name"):
        run_case(other, Session(checkpoints=tmp_path))
    words = ("run", "pulley_edc", *(f"--set={s}" for s in (PLAIN, *FREE, LONG, "output.frames=9")))
    refused = CliRunner().invoke(app, [*words, "--out", str(tmp_path)])
    assert refused.exit_code == 2
    assert "a part of a run of another case" in " ".join(refused.stderr.split())
    assert file.read_bytes() == kept
    anew = CliRunner().invoke(app, [*words, "--out", str(tmp_path), "--restart"])
    assert anew.exit_code in (0, 3), anew.output
    assert not file.exists()


def test_what_another_version_kept_goes_on_and_says_so(tmp_path: Path, monkeypatch) -> None:
    case = load_case("pulley_edc", [PLAIN, *FREE, LONG])
    with monkeypatch.context() as older:
        older.setattr(run_motion, "code_version", lambda: "0.0.0 cafe")
        cut_off(case, tmp_path, 1)
    words: list[str] = []
    result = run_case(case, Session(checkpoints=tmp_path), words.append)
    assert any("another version of the program (0.0.0 cafe)" in text for text in words)
    assert identical(result, run_case(case))


def fail_at_the_fortieth(moves: CoupledMotion, at: MotionState) -> MotionState:
    if at.coupled.time > 0.0385:
        raise ConvergenceError("hood: no equilibrium")
    return ADVANCE(moves, at)


def test_what_a_motion_reached_before_a_step_failed_is_kept(tmp_path: Path, monkeypatch) -> None:
    """Hours of computing went with it."""
    words = ["run", "pulley_edc", *(f"--set={s}" for s in (PLAIN, *FREE, LONG))]
    words += ["--out", str(tmp_path)]
    with monkeypatch.context() as broken:
        broken.setattr(CoupledMotion, "advance", fail_at_the_fortieth)
        failed = CliRunner().invoke(app, words)
    assert failed.exit_code == 1
    folder = tmp_path / "pulley_edc.unfinished"
    assert "at t = 0.039 s: hood: no equilibrium" in failed.stderr
    assert not (tmp_path / "pulley_edc").exists()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["converged"] is False
    data = xarray.load_dataset(folder / "results.nc", engine="h5netcdf")
    assert float(data.time[-1]) == pytest.approx(0.039)
    before = sorted(folder.rglob("*"))
    for file in ("a.html", "a.gif", "a.sto"):
        refused = CliRunner().invoke(app, ["show", str(folder), "-o", str(tmp_path / file)])
        assert refused.exit_code == 2, refused.output
        assert "is no result, only what a motion had reached" in " ".join(refused.stderr.split())
    assert sorted(folder.rglob("*")) == before
    with pytest.raises(InputError, match="is no result"):
        cosim.open_run(folder)
    with monkeypatch.context() as broken:
        broken.setattr(CoupledMotion, "advance", fail_at_the_fortieth)
        with pytest.raises(ConvergenceError) as error:
            cosim.run(load_case("pulley_edc", [PLAIN, *FREE, LONG]))
    assert error.value.reached.data.time[-1] == pytest.approx(0.039)
    with pytest.raises(InputError, match="is no result"):
        cosim.compare(error.value.reached, error.value.reached)
    resumed = CliRunner().invoke(app, ["run", "--resume", str(tmp_path / "pulley_edc")])
    assert resumed.exit_code in (0, 3), resumed.output
    assert not folder.exists()
    whole = run_case(load_case("pulley_edc", [PLAIN, *FREE, LONG]))
    assert identical(whole, cosim.open_run(tmp_path / "pulley_edc"))


def test_a_motion_s_hood_is_audited_as_that_of_an_equilibrium() -> None:
    """A soft contact lets the sheet sink into the bone, at rest and in a motion alike."""
    settings = (PLAIN, "hood.mesh.quads=120", 'hood.contact.stiffness="0.2 N/mm**3"')
    forward = 'forward={duration="3 ms",must_rest=false}'
    moved = run_case(load_case("motion_edc_fdp", [*settings, forward, "output.frames=1"]))
    assert moved.summary["max_penetration_mm"] > 0.05
    assert moved.audit.missed == ("max_penetration_mm",)
    assert {"guide_depth_mm", "hood_unstable_modes", "largest_interface_residual"} <= set(
        moved.audit.bounds
    )


def test_a_shape_on_the_way_counts_as_the_end_does() -> None:
    seen = [{"max_penetration_mm": depth} for depth in (0.0, 0.3, 0.1)]
    shapes = [{f"audit {k}": np.array(v) for k, v in at.items()} for at in seen[:2]]
    view = SimpleNamespace(audit=lambda: seen[2])
    end = SimpleNamespace(coupled=SimpleNamespace(hood=None))
    moved = SimpleNamespace(
        models=SimpleNamespace(built=SimpleNamespace(view=lambda hood: view)),
        history=SimpleNamespace(shapes=shapes, moment=end),
    )
    assert _largest_of_hood(moved) == {"max_penetration_mm": 0.3}


def stop(*_: Any) -> None:
    raise KeyboardInterrupt


def test_the_commands_resume_what_was_cut_off(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "ramp.toml"
    path.write_text(
        'extends = "pulley_edc"\ntitle = "ramp"\noutput.picture = false\n'
        '[finger.tip]\nkind = "free"\n[forward]\nduration = "0.1 s"\nmust_rest = false\n'
        "checkpoint = 20\n"
    )
    out = tmp_path / "runs"
    case = load_case(path)
    unfinished = out / "ramp.unfinished"
    cut_off(case, out, 1)
    kept = CliRunner().invoke(app, ["run", str(path), "--out", str(out)])
    assert kept.exit_code == 2
    words = f"Go on with: cosim run --resume {shown_path(unfinished)}; or add --restart"
    assert words in " ".join(kept.stderr.split())
    with monkeypatch.context() as early:  # Ctrl-C while the models are built
        early.setattr(run_motion, "moving_models", stop)
        stopped = CliRunner().invoke(app, ["run", "--resume", str(out / "ramp")])
    assert stopped.exit_code == 130
    assert "what was kept before stays. Go on with: cosim run --resume" in stopped.stderr
    done = CliRunner().invoke(app, ["run", "--resume", str(out / "ramp")])
    assert done.exit_code == 3, done.output  # without damping of its own it strikes its limits
    assert "going on from t = 0.049 s" in done.stderr
    assert (out / "ramp" / "summary.json").is_file()
    assert not unfinished.exists()
    again = CliRunner().invoke(app, ["run", "--resume", str(out / "ramp")])
    assert again.exit_code == 2
    assert "no motion was cut off here" in again.stderr
    cut_off(case, out, 1)
    anew = CliRunner().invoke(app, ["run", str(path), "--out", str(out), "--restart"])
    assert anew.exit_code == 3, anew.output
    assert "going on" not in anew.stderr
    assert not unfinished.exists()
    shutil.rmtree(out)
