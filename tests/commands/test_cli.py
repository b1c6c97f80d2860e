import json
import shlex
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer import Context
from typer.core import TyperGroup
from typer.main import get_command
from typer.testing import CliRunner

from cosim import pipeline
from cosim.case.file import resolved_toml
from cosim.cli import COMMANDS, app
from cosim.commands.listing import read_glossary
from cosim.commands.options import pairs_of
from cosim.errors import ConvergenceError, InputError
from cosim.outcome import Outcome
from cosim.results.arrays import Arrays
from cosim.results.audit import ADVICE, BOUNDS, missed_bounds
from cosim.results.parts import LedgerRow, Scene
from cosim.results.result import Result
from cosim.version import __version__
from tests.helpers.folders import ROOT

SUMMARY = {
    "posture_deg": {"MCP": 30.1, "MCP_abduction": 0.2, "PIP": 45.3, "DIP": 15.2},
    "tension_N": {"EDC": 3.469, "FDP": 0.05},
    "excursion_mm": {"EDC": 1.25},
    "slip_force_N": {"central": 1.5, "terminal": 0.75},
    "fingertip_force_N": {"distal": 0.24, "radial": -0.03, "dorsal": 0.39},
    "fingertip_magnitude_N": 0.459,
    "strain_percent": {"longitudinal": {"p5": -1.0, "mean": 0.8, "p95": 6.95}},
    "max_penetration_mm": 0.012,
    "moment_arm_mm": {"EDC": {"MCP": -7.4, "MCP_abduction": 0.1, "PIP": -5.2, "DIP": -2.1}},
    "audit": {"hood_force_balance": 3e-13},
    "iterations": {"coupling": 4, "newton": 21},
    "unloaded": {"fingertip_magnitude_N": 0.11, "slip_force_N": {"central": 0.1}},
    "difference": {"fingertip_magnitude_N": 0.349},
    "wall_s": 1.75,
}


@pytest.fixture
def solver(monkeypatch, tmp_path):
    """A stand-in for the solver; `fails` maps a case to the error that it meets, `ran` records."""
    fake = SimpleNamespace(fails={}, ran=[], summary=SUMMARY)

    def run_case(case, session, progress):
        progress("solving")
        fake.ran.append(case)
        if case.name in fake.fails:
            raise fake.fails[case.name]
        row = LedgerRow("loaded", "distal", "contact", np.zeros(3), np.zeros(3))
        told = {"case": case.name, **fake.summary}
        scene, text = Scene(None, (), ()), resolved_toml(case)
        return Result(told, Arrays.of({}, {}), (row,), scene, text, case.name)

    monkeypatch.setattr("cosim.commands.run.run_case", run_case)
    monkeypatch.chdir(tmp_path)
    return fake


def cosim(*words: str):
    return CliRunner().invoke(app, words, prog_name="cosim")


def test_version_and_help():
    assert cosim("--version").stdout == f"cosim {__version__}\n"
    commands = cosim("--help").stdout
    assert all(word in commands for word in ("run", "check", "show", "export", "import"))


def test_run_writes_and_shows_each_case(solver, tmp_path):
    done = cosim("run", "isometric_edc", "isometric_ei", "--set", "hood.mesh.quads=250")
    assert done.exit_code == 0, done.stderr
    assert [case.hood.mesh.quads for case in solver.ran] == [250, 250]
    for name in ("isometric_edc", "isometric_ei"):
        assert (Path("runs") / name / "summary.json").is_file()
        assert json.loads((tmp_path / "runs" / name / "summary.json").read_text())["case"] == name
    assert "isometric_edc: solving" in done.stderr


def test_the_table_shows_states_side_by_side(solver):
    lines = cosim("run", "isometric_edc").stdout.splitlines()
    (force,) = [line for line in lines if "fingertip force, magnitude, N" in line]
    assert force.split()[-2:] == ["0.459", "0.11"]
    (edc,) = [line.split() for line in lines if line.split()[:1] == ["EDC"]]
    assert edc == ["EDC", "3.469", "1.25", "-7.4", "0.1", "-5.2", "-2.1"]
    assert any("-1 to 6.95, mean 0.8" in line for line in lines)
    assert any("hood force balance" in line and "3.0e-13" in line for line in lines)


def test_a_motion_shows_its_energy_its_air_and_its_counts(solver):
    solver.summary = {
        "energy_mJ": {"own_tendons": 49.72},
        "air": {"FDP": {"command_V": 4.68, "pressure_kPa": 66.42}},
        "iterations": {"steps": 800, "hood_solves": 801, "newton": 21},
    }
    lines = [line.split() for line in cosim("run", "isometric_edc").stdout.splitlines()]
    assert "energy: own tendons mJ 49.72".split() in lines
    told = "cylinder of FDP at the end 4.68 V, 66.42 kPa above the atmosphere"
    assert told.split() in lines
    assert ["steps", "800"] in lines
    assert ["hood", "solves", "801"] in lines
    assert ["newton", "iterations", "21"] in lines


def test_a_run_without_a_deformable_hood_shows_what_it_has(solver):
    solver.summary = {"tension_N": {"EDC": 3.4}, "wall_s": 0.01}
    done = cosim("run", "isometric_edc")
    assert done.exit_code == 0
    assert "3.4" in done.stdout
    assert "slip" not in done.stdout


def test_one_bad_case_and_nothing_runs(solver, tmp_path):
    (tmp_path / "bad.toml").write_text('extends = "isometric_edc"\nhood.thickness = 0.6\n')
    done = cosim("run", "isometric_edc", "bad.toml", "nowhere")
    assert done.exit_code == 2
    assert "hood.thickness = 0.6 (bad.toml): is a bare number" in done.stderr
    assert "'nowhere': no such file" in done.stderr
    assert solver.ran == []
    assert not (tmp_path / "runs").exists()


def test_a_case_that_does_not_converge_does_not_stop_the_others(solver, tmp_path):
    solver.fails = {"isometric_edc": ConvergenceError("residual 3e-2 after 50 iterations")}
    done = cosim("run", "isometric_edc", "isometric_ei")
    assert done.exit_code == 1
    assert "isometric_edc: residual 3e-2 after 50 iterations" in done.stderr
    assert [p.name for p in (tmp_path / "runs").iterdir()] == ["isometric_ei"]


MOST = {
    "hood_force_balance": 1e-9,
    "hood_moment_balance": 1e-9,
    "finger_residual": 1e-6,
    "interface_residual": 1e-6,
    "reciprocity": 1e-3,
    "friction_beyond_cone": 1e-4,
    "friction_work_made": 1e-9,
    "second_start_force_N": 1e-3,
    "second_start_angle_deg": 1e-2,
    "tip_force_over_reach": 2.0,
    "unstable_modes_bones_free": 0,
    "torque_balance_at_rest": 1e-3,
    "max_penetration_mm": 0.02,
    "layer_used_up": 0.8,
    "guide_depth_mm": 0.05,
    "hood_unstable_modes": 0,
    "largest_interface_residual": 0.05,
    "energy_put_in_over_effort": 0.01,
}
"""What each figure of an audit may be at most, written down once more: a wider bound is seen."""


def test_every_bound_of_an_audit_has_its_figure():
    assert sorted(MOST) == sorted(BOUNDS)


@pytest.mark.parametrize(("name", "most"), MOST.items())
def test_a_figure_is_within_its_bound_up_to_there(name, most):
    assert missed_bounds({name: most}) == []
    assert missed_bounds({name: 1.001 * most + (most == 0)}) == [name]
    assert missed_bounds({name: float("nan")}) == [name]


@pytest.mark.parametrize(
    ("name", "voice"),
    [
        *((name, ()) for name in (*MOST, *ADVICE)),
        *(("reciprocity", (voice,)) for voice in ("--quiet", "--json")),
    ],
)
def test_a_missed_audit_is_said_last_and_is_an_exit_code(solver, tmp_path, name, voice):
    figures = {} if name in ADVICE else {name: MOST[name] + 1}
    solver.summary = SUMMARY | {"audit": figures, "audit_missed": [name]}
    done = cosim("run", "isometric_edc", *voice)
    assert done.exit_code == 3
    *_, loud, reason = done.stderr.splitlines()
    assert loud == "cosim: isometric_edc: THE AUDIT IS MISSED, do not trust this result"
    advice = ADVICE[name] if name in ADVICE else BOUNDS[name].advice
    assert reason.endswith(advice)
    assert reason.strip().startswith(name.replace("_", " "))
    assert (tmp_path / "runs" / "isometric_edc" / "summary.json").is_file()


def test_a_batch_ends_with_a_table_of_how_each_case_ended(solver):
    solver.summary = SUMMARY | {"max_penetration_mm": 0.034, "audit_missed": ["max_penetration_mm"]}
    solver.fails = {"isometric_ei": ConvergenceError("residual 3e-2 after 50 iterations")}
    done = cosim("run", "isometric_edc", "isometric_ei")
    assert done.exit_code == 1  # a case that failed counts for more than an audit that is missed
    table = done.stdout[done.stdout.rindex("ended") :].splitlines()
    rows = {line.split()[0]: line for line in table if "isometric" in line}
    assert "0.459" in rows["isometric_edc"]
    assert "AUDIT MISSED:" in rows["isometric_edc"]
    assert rows["isometric_ei"].rstrip().endswith("failed or stopped")
    assert "max penetration mm is 0.034, more than 0.02" in done.stderr.splitlines()[-1]


def test_ctrl_c_ends_a_batch_and_says_what_is_kept(solver, tmp_path):
    solver.fails = {"isometric_ei": KeyboardInterrupt()}
    done = cosim("run", "isometric_edc", "isometric_ei", "isometric_lum")
    assert done.exit_code == 130
    assert "isometric_ei: stopped before its end; nothing of this run is kept" in done.stderr
    assert [case.name for case in solver.ran] == ["isometric_edc", "isometric_ei"]
    assert any("isometric_lum" in x and "not begun" in x for x in done.stdout.splitlines())
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["isometric_edc"]


def test_a_fault_found_while_building_is_the_users(solver):
    solver.fails = {"isometric_edc": InputError("the surface is not watertight")}
    done = cosim("run", "isometric_edc")
    assert done.exit_code == 2
    assert "not watertight" in done.stderr


def test_results_that_cannot_be_written_are_told_before_the_run(solver, tmp_path):
    (tmp_path / "file").touch()
    done = cosim("run", "isometric_edc", "--out", "file")
    assert done.exit_code == 2
    assert "cannot be written" in done.stderr
    assert solver.ran == []


def test_two_cases_of_one_name_are_refused(solver, tmp_path):
    (tmp_path / "isometric_edc.toml").write_text('extends = "isometric_ei"\n')
    done = cosim("run", "isometric_ei", "isometric_edc.toml", "isometric_ei")
    assert done.exit_code == 2
    assert "two cases are named isometric_ei" in done.stderr


def test_schema_is_json():
    assert json.loads(cosim("explain", "--schema").stdout)["title"] == "CaseFile"


def test_mesh_writes_a_file_that_a_case_can_take(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = cosim("export", "isometric_edc", "--set", "hood.mesh.quads=120", "--out", "my.json")
    assert done.exit_code == 0, done.stderr
    count = len(json.loads(Path("my.json").read_text())["quads"])
    assert done.stdout == f"{count} quads in my.json\n"
    take = 'hood.mesh={kind="file", path="my.json"}'
    assert cosim("check", "isometric_edc", "--set", take).exit_code == 0


def test_a_mesh_that_cannot_be_made_or_written_is_told(tmp_path):
    done = cosim("export", "pulley_edc", "--out", str(tmp_path / "my.json"))
    assert done.exit_code == 2
    assert "has no mesh of quads" in done.stderr
    (tmp_path / "nowhere").touch()
    nowhere = str(tmp_path / "nowhere" / "my.json")
    done = cosim("export", "isometric_edc", "--set", "hood.mesh.quads=120", "--out", nowhere)
    assert done.exit_code == 2
    assert "cannot be written" in done.stderr


def test_view_says_where_the_picture_is_when_there_is_no_display(monkeypatch, tmp_path):
    for name in ("summary.json", "hood.vtu", "picture.png"):
        (tmp_path / name).touch()
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = cosim("show", str(tmp_path))
    assert done.exit_code == 0
    assert "no display" in done.stdout
    assert str(tmp_path / "picture.png") in done.stdout
    assert cosim("show", str(tmp_path / "elsewhere")).exit_code == 2


MESH = json.loads((ROOT / "meshes" / "hoods" / "index_416.json").read_text())
TWIN = MESH["quads"][4][0]
BAD = {
    "a missing mesh": ('mesh = {kind = "file", path = "none.json"}', "no such file"),
    "a mesh that is none": ('mesh = {kind = "file", path = "case.toml"}', "cannot be read as JSON"),
    "a bare number": ("thickness = 0.65", "hood.thickness = 0.65 (case.toml): is a bare number"),
    "another quantity": ('thickness = "3 kg"', "`kg` is no unit of length"),
    "an unknown key": ('thicknes = "1 mm"', "unknown key; did you mean thickness?"),
    "not a number": ('regions.central_slip.c5 = "nan MPa"', "is not finite"),
    "a bare not-a-number": ("regions.central_slip.lam_max = nan", "finite"),
    "a negative modulus": ('regions.central_slip.c5 = "-1 MPa"', "must be above 0 MPa"),
    "out of range": ('[finger.posture]\nPIP = "120 deg"', "must be 110 deg or less"),
    "a tendon twice": ("[tendons]\nEDC.tension = '1 N'\nEDC.tension = '2 N'", "given twice"),
    "a tendon in other letters": ("[tendons]\nEdc.tension = '1 N'", "named twice"),
    "an unknown tendon": ("[tendons]\nEDQ.tension = '1 N'", "did you mean EDC?"),
}
BAD_MESH = {
    "an unknown region": ({"regions": ["slip", *MESH["regions"][1:]]}, "unknown region 'slip'"),
    "no insertion": ({"springs": {}, "tied": {}}, "no insertion holds the hood"),
    "a point that is not finite": (
        {"points": [[float("nan"), 0, 0], *MESH["points"][1:]]},
        "points: row 0 holds a value that is not finite",
    ),
    "a node that is not there": ({"ends": MESH["ends"] | {"radial": [9999]}}, "ends.radial"),
    "another format": ({"format": "vtu"}, "is it a hood mesh?"),
    "an unknown insertion": ({"tied": {"distl": [1]}}, 'unknown name "distl"'),
    "two nodes at one place": (
        {
            "points": [*MESH["points"], MESH["points"][TWIN]],
            "station": [*MESH["station"], MESH["station"][TWIN]],
            "lift": [*MESH["lift"], MESH["lift"][TWIN]],
            "quads": [
                *MESH["quads"][:4],
                [len(MESH["points"]), *MESH["quads"][4][1:]],
                *MESH["quads"][5:],
            ],
        },
        f"node {len(MESH['points'])} lies where node {TWIN} does",
    ),
    "a loose node": (
        {key: MESH[key][:-1] for key in ("quads", "regions", "fibre")},
        "belongs to no quad",
    ),
}


def run_error(tmp_path: Path, text: str) -> str:
    """What `cosim run` says of a bad case; it must end with code 2 and leave nothing."""
    head = 'extends = "isometric_edc"\ntitle = "bad"\n'
    text = text if text.startswith("[") else f"[hood]\n{text}"
    (tmp_path / "case.toml").write_text(head + text)
    done = cosim("run", "case.toml", "--out", "runs")
    assert done.exit_code == 2, done.stdout
    assert "Traceback" not in done.stderr
    assert sum(line.startswith("cosim: ") for line in done.stderr.splitlines()) == 1
    assert not list(tmp_path.glob("runs/*"))
    return done.stderr


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_told_and_nothing_runs(tmp_path, monkeypatch, text, message):
    monkeypatch.chdir(tmp_path)
    assert message in run_error(tmp_path, text)


@pytest.mark.parametrize(("changes", "message"), BAD_MESH.values(), ids=BAD_MESH.keys())
def test_a_bad_mesh_is_told_with_its_place(tmp_path, monkeypatch, changes, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mesh.json").write_text(json.dumps(MESH | changes))
    assert message in run_error(tmp_path, 'mesh = {kind = "file", path = "mesh.json"}')
    checked = cosim("check", "case.toml", "isometric_edc")
    if changes.keys() != {"springs", "tied"}:  # what a case must bring to hold it, building tells
        assert checked.exit_code == 2
        assert message in checked.stderr
    assert "isometric_edc: in order" in checked.stdout


def test_the_program_ends_with_its_exit_code(tmp_path):
    (tmp_path / "bad.toml").write_text("title = \n")

    def code(*words: str) -> tuple[int, str]:
        command = [sys.executable, "-m", "cosim", *words]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    assert code("check", "isometric_edc") == (0, "")
    status, message = code("check", str(tmp_path / "bad.toml"))
    assert status == 2
    assert "line 1" in message
    assert "Traceback" not in message


def test_info_says_what_is_in_use(monkeypatch):
    monkeypatch.setenv("FE_SOLVER_LINEAR", "superlu")
    monkeypatch.setenv("FE_SOLVER_THREADS", "3")
    done = cosim("info")
    assert done.exit_code == 0
    assert __version__ in done.output
    assert "3 threads" in done.output
    assert "superlu, of" in done.output
    assert "pardiso" in done.output.split("faster would be")[1].lower()


@pytest.mark.parametrize(
    ("variable", "value"),
    [("FE_SOLVER_LINEAR", "abacus"), ("FE_SOLVER_THREADS", "0"), ("FE_SOLVER_THREADS", "many")],
)
def test_a_setting_that_cannot_be_met_is_refused(variable, value, monkeypatch):
    monkeypatch.setenv(variable, value)
    done = cosim("info")
    assert done.exit_code == 2
    assert f"{variable}={value}" in done.output


def test_every_command_is_found_and_tells_its_use():
    told = cosim("-h").stdout
    for heading, named in COMMANDS.items():
        assert f"{heading}:" in told
        for name, listed in named.items():
            assert listed.line in told
            help_text = cosim(name, "-h").stdout
            assert f"Usage: cosim {name} " in help_text, name
            assert help_text.rstrip().endswith(f"Example:\n    {listed.example}"), name


@pytest.mark.parametrize("listed", [c for named in COMMANDS.values() for c in named.values()])
def test_the_example_of_a_command_is_a_call_of_it(listed, monkeypatch):
    """Read as the shell and the program read it; what the command does has tests of its own."""
    _, name, *words = shlex.split(listed.example.partition(" > ")[0])
    command = get_command(app)
    inner = command.get_command(Context(command), name)
    while isinstance(inner, TyperGroup):
        head, *words = words
        inner = inner.get_command(Context(inner), head)
        assert inner is not None, head
    monkeypatch.setattr(Path, "exists", lambda _: True)  # a path that an option asks to be there
    inner.make_context(name, words)


def test_the_help_costs_little_beyond_what_prints_it():
    code = "import sys; from cosim.cli import app; app(['--help'], standalone_mode=False); "
    done = subprocess.run(
        [sys.executable, "-c", code + "print(*sys.modules)"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = set(done.stdout.split())
    assert not loaded & {"numpy", "pydantic", "cosim.port", "cosim.commands.run"}


def test_a_wrong_command_names_the_nearest():
    done = cosim("vaildate")
    assert done.exit_code == 2
    assert "Did you mean 'validate'" in done.stderr


def test_the_glossary_explains_words_and_axes():
    told = " ".join(cosim("explain").stdout.split())
    assert "palmar is minus dorsal" in told
    assert set(read_glossary()) >= {"excursion", "ledger", "audit", "slip force"}
    one = cosim("explain", "excursion").stdout
    assert "prescribed" in one
    assert "adhesion" not in one
    assert cosim("explain", "gearbox").exit_code == 2


LONG = [
    ("ladder", "pulley_edc", "-o"),
    ("converge", "isometric_edc", "-o"),
    ("lesion", "lesion_mallet", "--page"),
    ("study", "--sensitivity", "isometric_edc", "-o"),
    ("export", "fingertip_isotropic_edc", "-o"),
    ("reproduce", "networks", "-o"),
    ("moment-arms", "split_edc", "-o"),
]


@pytest.mark.parametrize("words", LONG)
def test_what_cannot_be_written_is_said_before_the_work(words, tmp_path):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    done = cosim(*words, str(tmp_path / "file" / "inner.toml"))
    assert done.exit_code == 2, done.output
    assert len(done.output.splitlines()) == 1, "nothing was solved before"
    assert "is no folder" in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_study_file_is_checked_too(tmp_path):
    done = cosim("check", "network_saltelli", "pulley_edc")
    assert done.exit_code == 0, done.output
    assert "network_saltelli: in order, a study of 640 runs" in done.output
    assert "pulley_edc: in order" in done.output
    (tmp_path / "bad.toml").write_text(
        'case = "pulley_edc"\n[parameters.PIP]\nvalues = ["20 deg"]\n'
        'settings = ["finger.posture.PIPP={value}"]\n[outputs]\nforce = "fingertip_magnitude_N"\n',
        encoding="utf-8",
    )
    done = cosim("check", str(tmp_path / "bad.toml"))
    assert done.exit_code == 2
    assert "did you mean PIP" in done.output


def test_a_process_that_is_ended_is_one_message(monkeypatch, tmp_path):
    def ended(cases, then, workers, checkpoints):
        yield 0, Outcome("converged", then(cosim_run(cases[0])))
        raise InputError("a process that solved was ended from outside")

    cosim_run = pipeline.run_case
    monkeypatch.setattr("cosim.commands.run.run_cases", ended)
    monkeypatch.chdir(tmp_path)
    done = cosim("run", "split_edc", "split_fdp", "--workers", "2", "--no-pictures")
    assert done.exit_code == 2
    assert "cosim: split_fdp: a process that solved was ended" in done.stderr
    assert (tmp_path / "runs" / "split_edc" / "summary.json").is_file()
    assert "failed or stopped" in done.stdout


def test_a_batch_side_by_side_leaves_what_one_by_one_leaves(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    names = ("split_edc", "split_fdp", "pulley_edc")
    for workers in ("1", "2"):
        done = cosim("run", *names, "--workers", workers, "--no-pictures", "--out", workers)
        assert done.exit_code == 0, done.output
        assert all(name in done.stdout for name in names)
        assert "3/3: " in done.stderr
    for name in names:
        for file in ("results.nc", "ledger.csv", "case.toml"):
            one, two = (tmp_path / workers / name / file for workers in "12")
            assert one.read_bytes() == two.read_bytes(), file


@pytest.mark.parametrize("text", ["EDC=", "=EDCI", "EDC", " = "])
def test_a_pair_that_lacks_a_side_is_refused(text):
    with pytest.raises(InputError, match=r"--muscle .*write, for example, --muscle EDC=EDCI"):
        pairs_of("--muscle", ["LUM=LU", text], "EDC=EDCI")
