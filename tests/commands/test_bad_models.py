"""Bad files through the command line: one message that says where, exit code 2, nothing left."""

from __future__ import annotations

import gzip
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cosim.cli import app
from cosim.errors import InputError
from fe_solver.febio import xml as feb_xml
from fe_solver.febio.read import read_feb
from fe_solver.job.checks import check_job

SKIN = '<material id="1" name="skin" type="isotropic elastic"><E>100</E><v>0.3</v></material>'
BOX = """<quad4 id="1">11,14,13,12</quad4><quad4 id="2">15,16,17,18</quad4>
<quad4 id="3">11,12,16,15</quad4><quad4 id="4">12,13,17,16</quad4>
<quad4 id="5">13,14,18,17</quad4><quad4 id="6">14,11,15,18</quad4>"""
MESH = f"""<Mesh><Nodes name="all">
<node id="1">0,0,0</node><node id="2">1,0,0</node><node id="3">2,0,0</node>
<node id="4">0,1,0</node><node id="5">1,1,0</node><node id="6">2,1,0</node>
<node id="11">0,0,-3</node><node id="12">2,0,-3</node><node id="13">2,2,-3</node>
<node id="14">0,2,-3</node><node id="15">0,0,-1</node><node id="16">2,0,-1</node>
<node id="17">2,2,-1</node><node id="18">0,2,-1</node></Nodes>
<Elements type="q4ans" name="sheet">
<elem id="1">1,2,5,4</elem><elem id="2">2,3,6,5</elem></Elements>
<Elements type="quad4" name="box">{BOX.replace("quad4", "elem").replace('id="', 'id="1')}</Elements>
<NodeSet name="edge">1,4</NodeSet><NodeSet name="end">3,6</NodeSet>
<ElementSet name="half">1</ElementSet>
<Surface name="under"><quad4 id="1">1,2,5,4</quad4><quad4 id="2">2,3,6,5</quad4></Surface>
<Surface name="lid">{BOX}</Surface>
<SurfacePair name="pair"><primary>under</primary><secondary>lid</secondary></SurfacePair>
<DiscreteSet name="strings"><delem>3,16</delem><delem>6,17</delem></DiscreteSet></Mesh>"""
THICK = "<shell_thickness>0.2</shell_thickness>"
HELD = (
    '<bc type="zero displacement" node_set="edge">'
    "<x_dof>1</x_dof><y_dof>1</y_dof><z_dof>1</z_dof></bc>"
)
CLAMPED = (
    '<bc type="zero shell displacement" node_set="edge">'
    "<sx_dof>1</sx_dof><sy_dof>1</sy_dof><sz_dof>1</sz_dof></bc>"
)
STRINGS = '<discrete dmat="1" discrete_set="strings"/>'
TEXT = f"""<?xml version="1.0" encoding="UTF-8"?>
<febio_spec version="4.0"><Module type="solid"/>
<Control><time_steps>1</time_steps><step_size>1</step_size></Control>
<Material>{SKIN}
<material id="2" name="bone" type="rigid body"><center_of_mass>0,0,0</center_of_mass></material>
</Material>
{MESH}
<MeshDomains><ShellDomain name="sheet" mat="skin">{THICK}</ShellDomain>
<ShellDomain name="box" mat="bone"/></MeshDomains>
<Boundary>{HELD}
{CLAMPED}</Boundary>
<Rigid><rigid_bc type="rigid_fixed"><rb>bone</rb><Rx_dof>1</Rx_dof><Ry_dof>1</Ry_dof>
<Rz_dof>1</Rz_dof><Ru_dof>1</Ru_dof><Rv_dof>1</Rv_dof><Rw_dof>1</Rw_dof></rigid_bc></Rigid>
<Loads><nodal_load type="nodal_force" node_set="end"><value lc="1">0,0,-0.001</value></nodal_load>
</Loads>
<Contact><contact type="sliding-elastic" name="touch" surface_pair="pair">
<auto_penalty>1</auto_penalty></contact></Contact>
<Discrete><discrete_material id="1" name="s" type="tension-only linear spring"><E>0.1</E>
</discrete_material>{STRINGS}</Discrete>
<LoadData><load_controller id="1" type="loadcurve"><points><pt>0,0</pt><pt>1,1</pt></points>
</load_controller></LoadData>
</febio_spec>
"""


def sub(*pairs: tuple[str, str]) -> str:
    """The valid file with places changed."""
    text = TEXT
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def nodes(more: str) -> tuple[str, str]:
    return '<node id="11">', f'{more}<node id="11">'


def add_fibre(fiber: str) -> str:
    law = "<c1>1</c1><c2>0</c2><c3>1</c3><c4>9</c4><c5>50</c5><lam_max>1.1</lam_max><k>100</k>"
    kind = "trans iso Mooney-Rivlin"
    return sub((SKIN, f'<material id="1" name="skin" type="{kind}">{law}{fiber}</material>'))


def piece(*more: tuple[str, str]) -> str:
    """A third element apart from the others."""
    four = (
        '<node id="21">5,0,0</node><node id="22">6,0,0</node><node id="23">6,1,0</node>'
        '<node id="24">5,1,0</node>'
    )
    third = ("2,3,6,5</elem>", '2,3,6,5</elem><elem id="3">21,22,23,24</elem>')
    return sub(third, nodes(four), *more)


LAUGHS = "".join(f'<!ENTITY a{i} "&a{i - 1};&a{i - 1};">' for i in range(1, 40))
BOMB = f'<!DOCTYPE a [<!ENTITY a0 "ha">{LAUGHS}]><febio_spec version="4.0">&a39;</febio_spec>'
OPEN = '<febio_spec version="4.0">'
UNHELD = ((HELD, ""), (CLAMPED, ""), (STRINGS, ""))
FLAT = '<quad4 id="1">11,14,13,12</quad4>'

BAD: dict[str, tuple[str | bytes, str]] = {
    # the mesh
    "two pieces": (piece(), "node 21: nothing holds its piece of the shell (2 pieces"),
    "no area": (
        sub(('5">1,1,0<', '5">1.5,0,0<'), ('4">0,1,0<', '4">0.5,0,0<')),
        "element 1 (part 'sheet') has no area",
    ),
    "bow-tie": (sub(("1,2,5,4</elem>", "1,5,2,4</elem>")), "element 1 (part 'sheet') is inverted"),
    "reflex": (sub(('1">0,0,0<', '1">0.9,0.9,0<')), "element 1 (part 'sheet') is inverted"),
    "node twice": (sub(("1,2,5,4</elem>", "1,2,2,4</elem>")), "names node 2 twice"),
    "turned over": (sub(("2,3,6,5</elem>", "2,5,6,3</elem>")), "wound in opposite senses"),
    "same element": (sub(("2,3,6,5</elem>", "2,5,4,1</elem>")), "have the same nodes"),
    "unmerged": (
        sub(
            ("2,3,6,5</elem>", "21,3,6,22</elem>"),
            nodes('<node id="21">1,0,0</node><node id="22">1,1,0</node>'),
        ),
        "node 2 lies where node 21 does",
    ),
    "same node number": (sub(('<node id="2">', '<node id="1">')), "node 1 is given twice"),
    "same element number": (sub(('<elem id="2">', '<elem id="1">')), "element 1 is given twice"),
    "two lists of nodes": (
        sub(("</Nodes>", '</Nodes><Nodes name="all"><node id="99">0,0,0</node></Nodes>')),
        "two lists of nodes are called 'all'",
    ),
    "no such node": (sub(("2,3,6,5</elem>", "2,3,77,5</elem>")), "there is no node 77"),
    "nan": (sub(('6">2,1,0<', '6">2,nan,0<')), "expected numbers (finite"),
    "infinite": (sub(('6">2,1,0<', '6">2,-inf,0<')), "expected numbers (finite"),
    "beyond floats": (sub(('6">2,1,0<', '6">2,1e200,0<')), "at most 1e+30"),
    "two ids": (sub(('<node id="6">', '<node id="6" x="1">')), "at most one attribute"),
    "no elements": (
        sub(
            ('<elem id="1">1,2,5,4</elem><elem id="2">2,3,6,5</elem>', ""), ('half">1', 'half">11')
        ),
        "this part has no elements",
    ),
    "huge node number": (sub(('id="6"', f'id="{10**18}"')), "whole number as its id"),
    "huge node named": (sub(("2,3,6,5</elem>", f"2,3,{10**18},5</elem>")), "numbers of nodes"),
    "negative node": (sub(('id="6"', 'id="-6"')), "whole number as its id"),
    "unknown element": (sub(('"q4ans"', '"quad5"')), "'quad5' are not read"),
    # names
    "node set": (sub(('node_set="edge"', 'node_set="rim"')), "no node set 'rim'"),
    "node in a set": (sub(('edge">1,4', 'edge">1,44')), "there is no node 44"),
    "node twice in a set": (sub(('edge">1,4', 'edge">1,4,1')), "node 1 comes twice"),
    "empty set": (sub(('edge">1,4', 'edge">')), "the node set 'edge' is empty"),
    "element in a set": (sub(('half">1', 'half">9')), "there is no element 9"),
    "surface": (sub(("<secondary>lid", "<secondary>lud")), "no surface 'lud'"),
    "pair": (sub(('surface_pair="pair"', 'surface_pair="pear"')), "no SurfacePair 'pear'"),
    "material": (sub(('mat="skin"', 'mat="skim"')), "no material 'skim'"),
    "part": (sub(('Domain name="sheet"', 'Domain name="street"')), "no elements called 'street'"),
    "discrete set": (sub(('"strings"/>', '"stings"/>')), "no DiscreteSet 'stings'"),
    "rigid body": (sub(("<rb>bone", "<rb>bane")), "no material 'bane'"),
    "load controller": (sub(('lc="1"', 'lc="7"')), "no load controller 7"),
    # values
    "zero thickness": (sub((THICK, THICK.replace("0.2", "0"))), "element 1 (part 'sheet') has the"),
    "negative thickness": (sub((THICK, THICK.replace("0.2", "-1"))), "thickness -0.001 m"),
    "nan thickness": (
        sub((THICK, THICK.replace("0.2", "nan"))),
        "shell_thickness>: the formula 'nan'",
    ),
    "no thickness": (sub((THICK, "")), "the thickness of element 1 is missing"),
    "absurd thickness": (sub((THICK, THICK.replace("0.2", "1e9"))), "check the units"),
    "fibre across": (add_fibre('<fiber type="vector">0,0,1</fiber>'), "normal to the shell"),
    "no fibre": (
        add_fibre('<fiber type="vector">0,0,0</fiber>'),
        "fibre direction [0.0, 0.0, 0.0]",
    ),
    "negative modulus": (sub(("<E>100", "<E>-100")), "E = -1e+08 is not allowed"),
    "incompressible": (sub(("<v>0.3", "<v>0.5")), "nu = 0.5 is not allowed"),
    "nu of -1": (sub(("<v>0.3", "<v>-1")), "nu = -1 is not allowed"),
    "unknown material": (sub(('"isotropic elastic"', '"Ogden"')), "'Ogden' is not known"),
    "no steps": (sub(("<time_steps>1</time_steps>", "")), "<time_steps>"),
    "negative step": (sub(("<step_size>1", "<step_size>-1")), "positive <step_size>"),
    "curve back in time": (sub(("<pt>1,1", "<pt>1,1</pt><pt>0.5,1")), "0.5 follows 1"),
    "spring on itself": (sub(("<delem>3,16", "<delem>3,3")), "joins node 3 to itself"),
    "negative friction": (
        sub(("<auto_penalty>", "<fric_coeff>-1</fric_coeff><auto_penalty>")),
        "friction coefficient must be 0 or positive",
    ),
    # rigid surfaces and contact
    "bone of no height": (
        sub(
            *[
                (f'id="{i}">{p},-1<', f'id="{i}">{p},-3<')
                for i, p in ((15, "0,0"), (16, "2,0"), (17, "2,2"), (18, "0,2"))
            ]
        ),
        "encloses no volume",
    ),
    "facet turned over": (
        sub(('"lid">' + BOX, '"lid">' + BOX.replace("11,12,16,15", "15,16,12,11"))),
        "not wound alike",
    ),
    "facet twice": (sub(('"2">2,3,6,5</quad4>', '"2">1,2,5,4</quad4>')), "comes twice"),
    "contact with itself": (sub(("<secondary>lid", "<secondary>under")), "one rigid body only"),
    # what nothing holds
    "nothing holds it": (sub(*UNHELD), "nothing holds the shell"),
    "hinged and unloaded": (
        sub((CLAMPED, ""), (STRINGS, ""), ("0,0,-0.001", "0,0,0")),
        "node 1 can turn about y",
    ),
    # the file
    "truncated": (TEXT[: len(TEXT) // 2], "not well-formed"),
    "empty": ("", "no element found"),
    "garbage": (bytes(range(256)) * 20, "not well-formed"),
    "compressed": (gzip.compress(TEXT.encode(), mtime=0), "not well-formed"),
    "another root": ("<html/>", "expected <febio_spec>"),
    "another section": (sub(("<Boundary>", "<Geometry/><Boundary>")), "is no section"),
    "version 2.5": (sub(('"4.0"', '"2.5"')), "'2.5' is not read"),
    "version 3.0": (sub(('"4.0"', '"3.0"')), "'3.0' is not read"),
    "entity bomb": (BOMB, "document type declaration"),
    "external entity": (
        f'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>{OPEN}&b;</febio_spec>',
        "document type declaration",
    ),
    "external declaration": (
        f'<!DOCTYPE a SYSTEM "http://x.invalid/a.dtd">{OPEN}</febio_spec>',
        "document type declaration",
    ),
    "a range of ids": (sub(('edge">1,4', 'edge">1:1000000000')), "got '1:1000000000'"),
    "deep": (OPEN + "<a>" * 100_000, "nested more than"),
    "long text": (OPEN + "<Mesh>" + "1," * 3_000_000, "longer than 4 MB"),
    "long row": (sub(('6">2,1,0<', f'6">{"2," * 9999}<')), "longer than 4096 letters"),
    "attributes": (
        sub(("<Boundary>", "<Boundary " + " ".join(f'a{i}="1"' for i in range(90_000)) + ">")),
        "more than 30 attributes",
    ),
    "long value": (sub(('"edge"', f'"{"e" * 5000}"')), "longer than 4096 letters"),
    "long name": (sub(("<Boundary>", f"<{'B' * 200}/><Boundary>")), "longer than 100 letters"),
    "underscore": (sub(('6">2,1,0<', '6">2,1_0,0<')), "got '2,1_0,0'"),
    "encoding": (sub(("UTF-8", "windows-1252")), "encoding"),
    "not UTF-8": (TEXT.replace("skin", "h\xe4ut").encode("latin-1"), "not well-formed"),
}


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def solve_error(tmp_path: Path, model: Path, *options: str) -> str:
    """What `cosim solve` says of a bad file; it must end with code 2 and leave nothing."""
    done = CliRunner().invoke(app, ["solve", str(model), "--out", str(tmp_path / "out"), *options])
    assert done.exit_code == 2, done.output
    *stages, message = done.stderr.splitlines()
    assert message.startswith("cosim: ")
    assert len(stages) <= 1  # "solving", where the file could be read
    assert not (tmp_path / "out").exists()
    return message


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_told_in_one_line(tmp_path: Path, name: str) -> None:
    content, words = BAD[name]
    model = tmp_path / "model.feb"
    model.write_bytes(content if isinstance(content, bytes) else content.encode())
    message = solve_error(tmp_path, model)
    assert words in message
    assert "model" in message
    assert len(message) < 500 + len(str(model))


@pytest.mark.parametrize("content", [TEXT, TEXT.replace(f'"lid">{BOX}', f'"lid">{FLAT}')])
def test_the_file_without_faults_is_solved(tmp_path: Path, content: str) -> None:
    model = tmp_path / "model.feb"
    model.write_text(content)
    done = CliRunner().invoke(app, ["solve", str(model), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output


def test_what_is_no_file(tmp_path: Path) -> None:
    assert "cannot be read" in solve_error(tmp_path, tmp_path / "absent.feb")
    assert "cannot be read" in solve_error(tmp_path, tmp_path)
    closed = tmp_path / "closed.feb"
    closed.write_text(TEXT)
    closed.chmod(0)
    if not os.access(closed, os.R_OK):
        assert "cannot be read" in solve_error(tmp_path, closed)


TAGS = "<Globals>" + "".join(f'<a{i} b="{i}"/>' for i in range(250_000))
LONG = "x" * 100
HOSTILE = {
    "tags": (TAGS, "more than 200000 tags"),
    "attributes": (
        "<Globals>" + "<a {}/>".format(" ".join(f'b{i}="{LONG}"' for i in range(29))) * 10_000,
        "more than 200000 tags",
    ),
    "names": (f"<Globals><{'a' * 500_000}>" + "<b/>" * 20_000, "not well-formed"),
    "texts": ("<Globals>" + f"<a>{'x' * 4000}</a>" * 10_000, "longer than 32 MB in all"),
    "numbers": (
        '<Mesh><NodeSet name="a">' + "12," * 1_390_000 + "</NodeSet></Mesh></febio_spec>",
        "there are no nodes",
    ),
    "characters": ("<Globals>" + "&#65;" * 5_000_000, "longer than 4 MB"),
}
LIMITED = """
import sys
from pathlib import Path
from time import process_time
from cosim.errors import InputError
from fe_solver.febio.read import read_feb

def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024

before = peak()
for name in sys.argv[1:]:
    began = process_time()
    try:
        read_feb(Path(name))
    except InputError as error:
        print(process_time() - began, peak() - before, error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads its peak memory from /proc")
def test_hostile_files_take_little_time_and_memory(tmp_path: Path) -> None:
    """Whatever stands in a file: it is refused within seconds and a bounded memory."""
    for name, (content, _) in HOSTILE.items():
        (tmp_path / f"{name}.feb").write_text(OPEN + content)
    files = [str(tmp_path / f"{name}.feb") for name in HOSTILE]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, *files], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == len(HOSTILE)
    for (name, (_, words)), line in zip(HOSTILE.items(), lines, strict=True):
        seconds, megabytes = map(float, line.split()[:2])
        assert f"{name}.feb" in line
        assert words in line
        assert seconds < 4.0, name  # measured: up to 1.2 s
        assert megabytes < 200.0, name  # measured: up to 120 MB


def test_rows_and_bytes_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = tmp_path / "model.feb"
    model.write_text(TEXT)
    monkeypatch.setattr(feb_xml, "LIMITS", replace(feb_xml.LIMITS, rows=20))
    assert "more than 20 rows" in solve_error(tmp_path, model)
    monkeypatch.setattr(feb_xml, "LIMITS", replace(feb_xml.LIMITS, bytes=1000))
    assert "the file is longer than" in solve_error(tmp_path, model)


# --- damage -----------------------------------------------------------------------------------


def read_or_refused(tmp_path: Path, content: bytes) -> None:
    """A file is read and checked, or refused by name: never anything else."""
    model = tmp_path / "model.feb"
    model.write_bytes(content)
    try:
        check_job(read_feb(model))
    except InputError as error:
        assert "model" in str(error)
        assert "\n" not in str(error)


BYTES = TEXT.encode()
damage = settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
places = st.integers(0, len(BYTES) - 1)


@damage
@given(st.lists(st.tuples(places, st.integers(0, 255)), min_size=1, max_size=4))
def test_changed_bytes(tmp_path: Path, changes: list[tuple[int, int]]) -> None:
    content = bytearray(BYTES)
    for place, value in changes:
        content[place] = value
    read_or_refused(tmp_path, bytes(content))


@damage
@given(places, places, st.sampled_from([b"", b"0", b"-1", b"1e29", b"1e-300", b"</a>", b"9,9,9"]))
def test_cuts_and_insertions(tmp_path: Path, start: int, end: int, new: bytes) -> None:
    end = min(max(start, end), start + 60)
    read_or_refused(tmp_path, BYTES[:start] + new + BYTES[end:])


@damage
@given(places, st.sampled_from(["0", "-1", "1e30", "1e-30", "17", "0.5", "nan", "3", "bone"]))
def test_changed_numbers(tmp_path: Path, place: int, new: str) -> None:
    """Another word in the place of the next number or word of a text."""
    start = TEXT.find(">", place) + 1
    end = min(i for i in (TEXT.find("<", start), TEXT.find(",", start), len(TEXT)) if i >= 0)
    read_or_refused(tmp_path, (TEXT[:start] + new + TEXT[end:]).encode())
