"""Muscle forces from OpenSim's tables into cases, FEBio's reactions into OpenSim's loads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree
from numpy.testing import assert_allclose, assert_array_equal
from typer.testing import CliRunner

from cosim.analyses.opensim.loads import Handover, axes_of, loads_of, mean
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError
from cosim.results.conventions import vector_of
from fe_solver.febio.log import RigidReactions, read_reactions
from rigid.opensim.external_loads import BodyLoad, write_external_loads
from rigid.opensim.sto import StoTable, read_sto, write_sto
from tests.helpers.folders import ROOT

DATA = """*Step  = 1
*Time  = 0.5
*Data  = Fx;Fy;Fz;Mx;My;Mz
2 1 2 3 10 20 30
3 -1 0 0.5 0 0 0
*Step  = 2
*Time  = 1
*Data  = Fx;Fy;Fz;Mx;My;Mz
2 3 4 5 30 40 50
3 -3 0 1.5 0 0 1e-3
"""
LOG = """===== beginning time step 1 : 0.5 =====
12 something with a number before it

Data Record #1
===========================================================================
Step = 1
Time = 0.5
Data = x;y;z
1 0.1 0.2 0.3

Data Record #2
===========================================================================
Step = 1
Time = 0.5
Data = Fx;Fy;Fz
2 1 2 3
3 -1 0 0.5

Data Record #3
===========================================================================
Step = 1
Time = 0.5
Data = Fx;Fy;Fz
File = elsewhere.txt

===== beginning time step 2 : 1 =====

Data Record #2
===========================================================================
Step = 2
Time = 1
Data = Fx;Fy;Fz
2 3 4 5
3 -3 0 1.5

 N O R M A L   T E R M I N A T I O N
"""
FORCE = np.array([[[1.0, 2, 3], [-1, 0, 0.5]], [[3, 4, 5], [-3, 0, 1.5]]])
TENSIONS = """forces
version=1
nRows=2
nColumns=4
inDegrees=no
endheader
time\tEDC1\t/forceset/fdp|tendon_force\tsoleus
0\t1\t2\t9
2\t3\t6\t9
"""


def write_log(folder: Path, text: str | bytes, name: str = "log.txt") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["import", *map(str, words)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def test_a_data_file_is_read(tmp_path):
    found = read_reactions([write_log(tmp_path, DATA)])
    assert found.bodies == (2, 3)
    assert_array_equal(found.time, [0.5, 1])
    assert_array_equal(found.force, FORCE)
    assert_array_equal(found.moment[:, 0], [[10, 20, 30], [30, 40, 50]])


def test_other_delimiters_and_orders_of_bodies_and_a_title_say_the_same(tmp_path):
    lines = [line if line[0] == "*" else line.replace(" ", ", ") for line in DATA.splitlines()]
    lines[3:5] = lines[4:2:-1]
    text = "*Title:hood\n" + "\n".join(lines) + "\n"
    assert_array_equal(read_reactions([write_log(tmp_path, text)]).force, FORCE)


def test_the_sections_of_a_log_are_read_and_those_of_other_records_left(tmp_path):
    found = read_reactions([write_log(tmp_path, LOG)])
    assert found.moment is None
    assert_array_equal(found.force, FORCE)


def test_a_file_for_each_body_and_a_named_record(tmp_path):
    rows = {b: [line for line in DATA.splitlines() if line[:1] in ("*", b)] for b in "23"}
    paths = [write_log(tmp_path, "\n".join(rows[b]) + "\n", f"{b}.txt") for b in "23"]
    assert_array_equal(read_reactions(paths).force, FORCE)
    named = write_log(tmp_path, DATA.replace("Fx;Fy;Fz;Mx;My;Mz", "reaction"), "named.txt")
    columns = "Fx Fy Fz Mx My Mz".split()
    assert_array_equal(read_reactions([named], columns).force, FORCE)


BAD = {
    "cut off within a row": (DATA[:-8] + "\n", "line 10: 4 values of body 3, expected 6"),
    "cut off within a number": (DATA[:-1], "line 10: the file ends within a line"),
    "cut off before a body": (DATA[: DATA.rindex("3 -3")], "line 6, time 1: body 3 is missing"),
    "cut off before the rows": (DATA[: DATA.rindex("2 3")], "line 6: the record that begins here"),
    "cut off before the time": (DATA[: DATA.index("*Time")], "no Time and no Data line"),
    "not a number": (DATA.replace("20", "nan"), "line 4, value 5: 'nan', expected a finite"),
    "Windows's": (DATA.replace("20", "-nan(ind)"), "value 5: '-nan(ind)'"),
    "beyond": (DATA.replace("20", "1e999"), "value 5: '1e999'"),
    "python's": (DATA.replace("20", "2_0"), "value 5: '2_0'"),
    "time": (DATA.replace("= 0.5", "= nan"), "line 2, Time: 'nan'"),
    "body missing first": (DATA.replace("3 -1 0 0.5 0 0 0\n", ""), "line 1, time 0.5: body 3"),
    "body twice": (DATA.replace("3 -1", "2 -1"), "line 5: body 2 comes twice"),
    "steps turned": ("".join(DATA.partition("*Step  = 2")[i] for i in (1, 2, 0)),
                     "line 6: time 0.5 follows 1; times must increase"),
    "other columns": (DATA.replace("Fx;Fy;Fz", "Fx;Fz;Fy", 1), "the columns are Fx;Fy;Fz"),
    "a component missing": (DATA.replace("Fx;", "ax;"), "body 2 has no Fx"),
    "no comments": ("2 1 2 3\n", "line 1: '2 1 2 3' without *Step"),
    "another record": (DATA.replace("Fx;Fy;Fz;Mx;My;Mz", "a;b;c;d;e;f"), "no record of rigid"),
    "empty": ("", "no record of rigid"),
    "no text": (b"\xff\xfe\n", "is no text in UTF-8"),
    "log of a run that failed": (LOG.replace("N O R M A L", "E R R O R"), "did not end well"),
    "log cut off": (LOG[: LOG.rindex("3 -3")], "did not end well"),
    "extract cut off": (
        LOG.replace("beginning", "")[: LOG.rindex("3 -3") - 18], "body 3 is missing"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_log_is_refused_with_its_place(case, tmp_path):
    text, fragment = BAD[case]
    with pytest.raises(InputError) as caught:
        read_reactions([write_log(tmp_path, text)])
    assert "log.txt" in str(caught.value)
    assert fragment in str(caught.value)
    assert len(str(caught.value)) < 450


def test_files_that_do_not_belong_together_are_refused(tmp_path):
    one = write_log(tmp_path, DATA)
    with pytest.raises(InputError, match="Fx of body 2 comes twice"):
        read_reactions([one, one])
    later = write_log(tmp_path, DATA.replace("= 1\n", "= 1.5\n"), "later.txt")
    with pytest.raises(InputError, match="Log all bodies at the same times"):
        read_reactions([one, later])
    with pytest.raises(InputError, match="cannot be read"):
        read_reactions([tmp_path / "none.txt"])


PIECES = st.sampled_from(
    [*DATA.splitlines(keepends=True), *LOG.splitlines(keepends=True), "2 1\n", "nan ", "=", "*Time"]
)
TEXTS = st.one_of(
    st.binary(max_size=200),
    st.lists(PIECES, max_size=12).map("".join).map(str.encode),
    st.tuples(st.integers(0, len(DATA)), st.binary(max_size=3)).map(
        lambda cut: DATA.encode()[: cut[0]] + cut[1] + DATA.encode()[cut[0] + 1 :]
    ),
)
SAME_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


@SAME_FOLDER
@given(raw=TEXTS)
def test_whatever_stands_in_a_log_it_is_read_or_refused(raw, tmp_path):
    try:
        found = read_reactions([write_log(tmp_path, raw)])
    except InputError:
        return
    assert found.force.shape == (len(found.time), len(found.bodies), 3)
    assert np.isfinite(found.force).all()
    assert (np.diff(found.time) > 0).all()


@SAME_FOLDER
@given(
    force=st.lists(
        st.tuples(*[st.floats(-1e6, 1e6)] * 3), min_size=1, max_size=4
    ),
    axes=st.sampled_from(["-x -z -y", "x y z", "y z x", "-x -y z"]),
)  # fmt: skip
def test_forces_come_back_through_both_files(force, axes, tmp_path):
    values = np.array(force)[:, None]
    found = RigidReactions(np.arange(len(force)) + 0.5, (4,), values, None)
    time, loads = loads_of(found, Handover({4: "distal"}, {"distal": np.zeros(3)}, axes))
    mot, _ = write_external_loads(tmp_path / "l.mot", time, loads)
    back = read_sto(mot)
    assert_array_equal(back.time, found.time)
    assert_allclose(back.values[:, :3] @ axes_of(axes), values[:, 0], atol=0, rtol=1e-15)
    assert_array_equal(back.values[:, 3:], np.zeros((len(force), 3)))


def test_the_thesis_axes_turn_and_do_not_mirror():
    assert_array_equal(axes_of("-x -z -y") @ [1, 2, 3], [-1, -3, -2])
    assert np.linalg.det(axes_of("-x -z -y")) == pytest.approx(1.0)
    for text, fragment in (
        ("x y -z", "mirror"), ("x x z", "each of x, y, z once"), ("", "each of"), ("x y", "each of")
    ):  # fmt: skip
        with pytest.raises(InputError, match=fragment):
            axes_of(text)


def test_the_mean_over_time_of_a_ramp_is_its_middle():
    time = np.array([0.0, 0.1, 0.7, 1.0])
    values = np.column_stack([2 * time, np.ones(4)])
    assert_allclose(mean(time, values, (0.05, 0.95)), [1.0, 1.0], rtol=1e-14)
    assert_allclose(mean(time, values, (0.5, 0.5)), [1.0, 1.0], rtol=1e-14)
    for window in ((-0.1, 1.0), (0.5, 0.4), (0.0, np.nan)):
        with pytest.raises(InputError, match="two times that rise"):
            mean(time, values, window)


def test_the_command_writes_what_the_thesis_handed_over(tmp_path):
    log, out = write_log(tmp_path, DATA), tmp_path / "loads.mot"
    words = [log, "--body", "2=proximal", "--point", "proximal=0.02 0 -0.001"]
    code, said = run(*words, "--mean", 0.5, 1, "-o", out)
    assert code == 0, said
    assert "left out: body 3" in said
    table = read_sto(out)
    assert table.columns == tuple(
        f"proximal_{what}{axis}" for what in ("force_v", "force_p", "torque_") for axis in "xyz"
    )
    assert (table.time[0], table.time[-1], len(table.time)) == (0.0, 2.0, 201)
    expected = [-2, -4, -3, 0.02, 0, -0.001, -0.02, -0.04, -0.03]
    assert_allclose(table.values, np.tile(expected, (201, 1)), rtol=1e-14)
    head = out.read_text().splitlines()[:6]
    assert head == [
        "loads", "version=1", "nRows=201", "nColumns=10", "inDegrees=no", "endheader"
    ]  # fmt: skip
    force = etree.parse(tmp_path / "loads.xml").find("ExternalLoads/objects/ExternalForce")
    assert {tag.tag: tag.text for tag in force} == {
        "isDisabled": "false",
        "applied_to_body": "proximal",
        "force_expressed_in_body": "ground",
        "point_expressed_in_body": "proximal",
        "force_identifier": "proximal_force_v",
        "point_identifier": "proximal_force_p",
        "torque_identifier": "proximal_torque_",
    }
    assert force.getparent().getparent().find("datafile").text == "loads.mot"
    code, said = run(*words, "--opposite", "--no-moments", "--axes", "x y z", "-o", out)
    assert code == 0, said
    assert_array_equal(read_sto(out).values[:, :3], -FORCE[:, 0])
    assert len(read_sto(out).columns) == 6


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        (["--body", "7=proximal"], "has no body 7; it has 2, 3"),
        (["--body", "proximal=2"], "write FEBio's number of the body first"),
        (["--body", "2"], "write, for example"),
        (["--body", "2=proximal", "--body", "3=proximal"], "'proximal' comes twice"),
        (["--body", "2=middle"], "say where its force acts"),
        (["--body", "2=proximal", "--point", "proximal=1 2"], "three numbers"),
        (["--body", "2=proximal", "--axes", "x z y"], "mirror"),
        (["--body", "2=proximal", "--mean", "0", "1"], "from 0.5 to 1"),
        (["--body", "2=proximal", "--mean", "0.5", "1", "--duration", "0"], "--duration 0"),
        (["--body", "2=proximal", "--force-unit", "lbf"], "force-unit"),
    ],
)
def test_the_command_says_what_is_missing(words, fragment, tmp_path):
    log = write_log(tmp_path, DATA)
    point = [] if "middle" in words[1] or "--point" in words else ["--point", "proximal=0 0 0"]
    code, said = run(log, *words, *point, "-o", tmp_path / "l.mot")
    assert code == 2
    assert fragment in said
    assert [path.name for path in tmp_path.iterdir()] == ["log.txt"]


def test_names_that_opensim_or_xml_cannot_hold_are_refused(tmp_path):
    one = np.zeros((1, 3))
    for name in ("a b", "a=b", "a\x00b"):
        with pytest.raises(InputError):
            write_external_loads(tmp_path / "l.mot", np.zeros(1), [BodyLoad(name, one, one[0])])
    with pytest.raises(InputError, match=r"name the table \.mot"):
        write_external_loads(tmp_path / "l.xml", np.zeros(1), [BodyLoad("a", one, one[0])])


def test_tensions_become_a_case_over_another(tmp_path):
    table, out = write_log(tmp_path, TENSIONS, "f.sto"), tmp_path / "sub/mine.toml"
    words = [table, "--column", "EDC=EDC1", "-o", out]
    code, said = run(*words, "--time", 1)
    assert code == 0, said
    assert "left out: soleus" in said
    assert "pulls as in" not in said
    case = load_case(out)
    assert {n: t.tension for n, t in case.tendons.items() if t.tension} == {"EDC": 2.0, "FDP": 4.0}
    assert case.hood == load_case("base/index_finger.toml").hood
    over = tmp_path / "over.toml"
    code, said = run(table, "--column", "EDC=EDC1", "-o", over, "--extends", out)
    assert code == 0, said
    assert load_case(over).tendons["EDC"].tension == 3.0  # the last time
    code, said = run(table, "-o", over, "--extends", "isometric_edc")
    assert "EDC: pulls as in isometric_edc" in said


def test_tensions_over_time_become_the_courses_of_a_motion(tmp_path):
    from cosim.tendons.signals import factor_of

    table, out = write_log(tmp_path, TENSIONS, "f.sto"), tmp_path / "m.toml"
    words = [table, "--column", "EDC=EDC1", "--over-time", "-o", out]
    code, said = run(*words, "--extends", "forward_edc")
    assert code == 0, said
    tendon = load_case(out).tendons["EDC"]
    assert tendon.tension * factor_of(tendon.signal)(0.5) == pytest.approx(1.5)
    code, said = run(*words, "--extends", "hood_rest")
    assert code == 2
    assert "is no motion" in said
    short = write_log(tmp_path, TENSIONS.replace("\n2\t", "\n1\t"), "f.sto")
    code, said = run(short, *words[1:], "--extends", "forward_edc")
    assert code == 2
    assert "spans 0 to 1 s" in said


@pytest.mark.parametrize(
    ("text", "words", "fragment"),
    [
        (TENSIONS, ["--time", "3"], "the table spans 0 to 2 s"),
        (TENSIONS, ["--time", "nan"], "the table spans"),
        (TENSIONS, ["--column", "EDC=edc"], "has no column 'edc'; it has EDC1"),
        (TENSIONS, ["--column", "BICEPS=EDC1"], "tendons are EDC"),
        (TENSIONS, ["--column", "EDC"], "write, for example"),
        (TENSIONS, ["--time", "1", "--over-time"], "one of the two"),
        (TENSIONS, ["--extends", "nowhere"], "no such file and no packaged case"),
        (TENSIONS.replace("EDC1", "x/FDP"), [], "FDP could be x/FDP or /forceset/fdp"),
        (TENSIONS.replace("fdp", "x"), [], "no column has the name of a tendon"),
        (TENSIONS.replace("\t6\t", "\t-6\t"), [], "time 2 s: -6 N for the tendon FDP"),
        (TENSIONS.replace("\t6\t", "\tNaN\t"), [], "line 9, column 3: NaN"),
        (TENSIONS.replace("\t6\t", "\t1e6\t"), [], "tendons.FDP.tension"),
        (TENSIONS.replace("fdp", "UI"), ["--extends", "split_edc"], "have no such tendon"),
        (TENSIONS.replace("endheader\n", ""), [], "endheader is missing"),
        (TENSIONS[: TENSIONS.index("0\t1")].replace("=2", "=0"), [], "no rows"),
    ],
)
def test_tensions_that_are_none_are_refused(text, words, fragment, tmp_path):
    table = write_log(tmp_path, text, "f.sto")
    code, said = run(table, *words, "-o", tmp_path / "mine.toml")
    assert code == 2
    assert fragment in said
    assert [path.name for path in tmp_path.iterdir()] == ["f.sto"]


@SAME_FOLDER
@given(
    raw=st.one_of(
        st.binary(max_size=100),
        st.tuples(st.integers(0, len(TENSIONS)), st.binary(max_size=3)).map(
            lambda cut: TENSIONS.encode()[: cut[0]] + cut[1] + TENSIONS.encode()[cut[0] + 1 :]
        ),
    )
)
def test_whatever_stands_in_a_table_it_is_taken_or_refused(raw, tmp_path):
    table, out = write_log(tmp_path, raw, "f.sto"), tmp_path / "mine.toml"
    code, said = run(table, "-o", out, "--extends", "base/split")
    assert code in (0, 2), said


@pytest.mark.opensim
def test_opensim_applies_what_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # opensim leaves a log where it is imported
    opensim = pytest.importorskip("opensim")
    time = np.linspace(0.0, 1.0, 11)
    force, moment = np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, -0.3])
    load = BodyLoad(
        "bone", np.tile(force, (11, 1)), np.array([0.5, 0.0, 0.0]), np.tile(moment, (11, 1))
    )
    _, xml = write_external_loads(tmp_path / "l.mot", time, [load])
    model = opensim.Model()
    model.setGravity(opensim.Vec3(0))
    body = opensim.Body("bone", 2.0, opensim.Vec3(0), opensim.Inertia(1, 1, 1, 0, 0, 0))
    model.addBody(body)
    model.addJoint(opensim.FreeJoint("free", model.getGround(), body))
    model.addModelComponent(opensim.ExternalLoads(str(xml), True))
    state = model.initSystem()
    model.realizeAcceleration(state)
    linear = body.getLinearAccelerationInGround(state)
    angular = body.getAngularAccelerationInGround(state)
    assert_allclose([linear.get(i) for i in range(3)], force / 2, rtol=1e-9)
    about_centre = moment + np.cross([0.5, 0.0, 0.0], force)
    assert_allclose([angular.get(i) for i in range(3)], about_centre, rtol=1e-9)


@pytest.mark.opensim
def test_a_force_reporters_table_of_opensim_is_taken(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    opensim = pytest.importorskip("opensim")
    table = opensim.TimeSeriesTable()
    table.setColumnLabels(["/forceset/EDC|tendon_force", "/forceset/EDC|fiber_length"])
    for at in (0.0, 2.0):
        table.appendRow(at, opensim.RowVector([1.0 + at, 0.07]))
    opensim.STOFileAdapter.write(table, str(tmp_path / "f.sto"))
    code, said = run(tmp_path / "f.sto", "-o", tmp_path / "mine.toml")
    assert code == 0, said
    assert load_case(tmp_path / "mine.toml").tendons["EDC"].tension == 3.0


def test_a_model_gives_the_centres_of_mass(tmp_path):
    model = ROOT / "cases/data/finger.osim"
    log, out = write_log(tmp_path, DATA), tmp_path / "l.mot"
    code, said = run(log, "--body", "2=proximal", "--model", model, "-o", out)
    assert code == 0, said
    from cosim.analyses.opensim.loads import mass_centres

    table = read_sto(out)
    assert_array_equal(table.values[0, 3:6], mass_centres(model)["proximal"])
    code, said = run(log, "--body", "2=femur", "--model", model, "-o", out)
    assert code == 2
    assert "has no body 'femur'" in said


def test_a_table_with_other_columns_than_forces_is_untouched(tmp_path):
    before = StoTable("t", ("EDC", "x"), np.array([0.0, 1.0]), np.array([[1.0, 2], [3, 4]]))
    write_sto(tmp_path / "f.sto", before)
    code, said = run(tmp_path / "f.sto", "-o", tmp_path / "mine.toml")
    assert code == 0, said
    assert read_sto(tmp_path / "f.sto").columns == ("EDC", "x")


def test_the_tensions_of_a_run_make_the_same_force_again(tmp_path):
    from cosim.pipeline import run_case
    from cosim.results.sto import write_tables

    first = run_case(load_case("split_edc", ["output.picture=false"]))
    folder = first.save(tmp_path)
    _, forces = write_tables(folder, tmp_path / "run.sto")
    code, said = run(forces, "--extends", "base/split.toml", "-o", tmp_path / "again.toml")
    assert code == 0, said
    assert "left out: fingertip_force_vx" in said
    again = run_case(load_case(tmp_path / "again.toml", ["output.picture=false"]))
    force = [vector_of(result.summary["fingertip_force_N"]) for result in (first, again)]
    assert_allclose(force[1], force[0], atol=1e-9)
