"""Inputs that ask for more than there is: refused by their sizes and counts, before any work."""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cosim.anatomy.bones import load_surface
from cosim.case.file import case_of, load_case
from cosim.errors import InputError, nearest_names
from cosim.files import MB, read_bytes
from cosim.hoods.shell.table import ENDS as SHELL_ENDS
from cosim.mesh_file import read_mesh_file
from cosim.models.build import build
from cosim.models.fit import check_fit
from cosim.study.file import read_file
from cosim.study.plan import read_plan
from cosim.text_tables import read_csv, read_toml
from fe_solver.febio.log import read_reactions
from meshes.hood_mesh import ENDS
from meshes.hood_mesh import read as read_hood_mesh
from rigid.mjcf.bounds import check_bounds
from rigid.mjcf.read import read_mjcf
from rigid.opensim.sto import read_sto

READERS: dict[str, Callable[[Path], object]] = {
    "case.toml": read_toml,
    "signal.csv": lambda path: read_csv(path, "time,force"),
    "states.sto": read_sto,
    "hood.json": read_hood_mesh,
    "hood.inp": read_mesh_file,
    "hood.msh": read_mesh_file,
    "hood.vtu": read_mesh_file,
    "hood.obj": read_mesh_file,
    "bone.stl": lambda path: load_surface(path, "proximal"),
    "finger.xml": read_mjcf,
    "forces.log": lambda path: read_reactions([path]),
}


def sparse(path: Path, size: int = 3 << 30) -> Path:
    """A file of so many bytes that takes no room."""
    with path.open("wb") as file:
        file.truncate(size)
    return path


@pytest.mark.parametrize("name", READERS)
def test_a_file_of_gigabytes_is_refused_unread(name, tmp_path):
    with pytest.raises(InputError, match=f"{name}.* has 3,072 MB") as caught:
        READERS[name](sparse(tmp_path / name))
    assert len(str(caught.value)) < 300


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="a device of endless bytes")
def test_a_device_without_end_is_refused():
    with pytest.raises(InputError, match="more than 1 MB"):
        read_bytes(Path("/dev/zero"), MB)


@pytest.mark.parametrize(
    ("key", "table"),
    [
        ("finger.bones.proximal.surface", {"unit": "mm", "frame": "ours"}),
        ("finger.path", {}),
        ("hood.mesh.path", {"kind": "file"}),
        ("hood.points_file", {}),
        ("tendons.EDC.signal.path", {"kind": "file", "column": "f"}),
    ],
)
def test_a_case_that_names_a_file_of_gigabytes_is_refused_with_its_key(key, table, tmp_path):
    path = str(sparse(tmp_path / "large"))
    values = {key.rpartition(".")[0]: table} if table else {}
    with pytest.raises(InputError, match=rf"{key} = .*3,072 MB"):
        load_case("isometric_edc").replace({**values, key: path})


def test_a_long_chain_of_cases_is_refused(tmp_path):
    names = [f"c{i}.toml" for i in range(1500)]
    for name, base in pairwise([*names, "split_edc"]):
        (tmp_path / name).write_text(f'extends = "{base}"\n')
    with pytest.raises(InputError, match="more than 50 files"):
        load_case(tmp_path / "c0.toml")
    assert load_case(tmp_path / "c1460.toml").hood.kind == "split"


STUDY = 'case = "split_edc"\n[outputs]\nt = "fingertip_magnitude_N"\n'
AXIS = """[parameters.a{i}]
from = "1 N"
to = "2 N"
count = {count}
settings = ["tendons.EDC.tension={{value}}"]
"""
LAW = """[parameters.d]
distribution = "uniform"
low = "1 N"
high = "2 N"
settings = ["tendons.EDC.tension={value}"]
"""


def study(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(STUDY + text)
    return path


def axes(*counts: int) -> str:
    return "".join(AXIS.format(i=i, count=n) for i, n in enumerate(counts))


def sampled(kind: str, n: int) -> str:
    return f'{LAW}[sampling]\nkind = "{kind}"\nn = {n}\nseed = 1\n'


@pytest.mark.parametrize(
    ("text", "runs"),
    [
        (axes(100_000, 100_000), "10,000,000,000"),
        (axes(*[100_000] * 1000), "at least 10,000,000,000"),
        (axes(1001, 100), "100,100"),
        (sampled("saltelli", 2**22), "12,582,912"),
        (sampled("sobol", 2**17), "131,072"),
        (sampled("random", 1001) + axes(100), "100,100"),
    ],
)
def test_a_study_of_too_many_runs_is_refused_by_their_count(text, runs, tmp_path):
    with pytest.raises(InputError, match=f"has {runs} runs .*limits.runs allows 100,000"):
        read_file(study(tmp_path, text))


def test_the_bound_of_a_study_can_be_raised(tmp_path):
    more = "[limits]\nruns = 200000\n"
    assert read_plan(study(tmp_path, sampled("sobol", 2**17) + more)).count == 2**17


@pytest.mark.parametrize("text", [axes(3, 4), sampled("saltelli", 8), sampled("random", 5)])
def test_a_study_has_as_many_points_as_are_counted(text, tmp_path):
    plan = read_plan(study(tmp_path, text))
    assert plan.count == len(plan.points)


FAULTY = {
    "unknown tendons": {"tendons": {f"x{i}": "1" for i in range(3000)}},
    "long unknown regions": {"hood": {"regions": {f"{'central_' * 40}{i}": 1 for i in range(500)}}},
    "unknown keys": {f"key{i}": 1 for i in range(3000)},
}


@pytest.mark.parametrize("values", FAULTY.values(), ids=FAULTY)
def test_of_thousands_of_faults_the_first_are_listed_and_all_counted(values):
    with pytest.raises(InputError) as caught:
        case_of({"extends": "isometric_edc", **values})
    head, *lines = str(caught.value).split("\n  ")
    count = int(head.split()[-2])
    assert count >= 500
    assert len(lines) == 21
    assert lines[-1] == f"... and {count - 20} more; mend these first"
    assert len(str(caught.value)) < 20_000


def test_a_long_list_of_one_part_is_refused():
    cuts = ["terminal_slip"] * 100_000
    with pytest.raises(InputError, match="names terminal_slip twice"):
        case_of({"extends": "lesion_mallet", "lesion": {"cut": cuts}})


@pytest.mark.parametrize("letters", ["x" * 100_000, "terminal_slip" * 10_000])
def test_a_name_of_any_length_is_compared_at_once(letters):
    assert nearest_names(letters, ["terminal_slip", "central_slip"]) == []


def world(text: str) -> str:
    return f"<mujoco><worldbody><body name='b'>{text}</body></worldbody></mujoco>"


GEOM = "<geom size='1'/>"
EXPANDING = {
    "copies": world(f"<replicate count='1000000' offset='1 0 0'>{GEOM}</replicate>"),
    "copies of copies": world("<replicate count='100'>" * 3 + GEOM + "</replicate>" * 3),
    "copies over a file": world("<replicate count='100'><include file='self.xml'/></replicate>"),
    "composite": world("<composite type='cable' count='1000000 1 1'/>"),
    "grid": world("<flexcomp name='f' type='grid' count='2000 2000 2000'/>"),
    "height field": "<mujoco><asset><hfield nrow='30000' ncol='30000'/></asset></mujoco>",
    "texture": "<mujoco><asset><texture width='90000' height='90000'/></asset></mujoco>",
    "memory": "<mujoco><size memory='100G'/></mujoco>",
    "user data": "<mujoco><size nuserdata='2000000000'/></mujoco>",
    "numbers": "<mujoco><custom><numeric name='n' size='2000000000'/></custom></mujoco>",
    "keyframes": f"<mujoco><keyframe>{'<key/>' * 30_000}</keyframe></mujoco>",
    "itself": "<mujoco><include file='self.xml'/></mujoco>",
    "large mesh": "<mujoco><asset><mesh file='large.stl'/></asset></mujoco>",
    "large mesh elsewhere": "<mujoco><compiler meshdir='..'/><asset><mesh file='{0}/large.stl'/>"
    "</asset></mujoco>",
}


@pytest.mark.parametrize("text", EXPANDING.values(), ids=EXPANDING)
def test_a_mujoco_model_that_expands_is_refused_before_it_is_compiled(text, tmp_path):
    sparse(tmp_path / "large.stl")
    (tmp_path / "self.xml").write_text(text.format(tmp_path.name))
    with pytest.raises(InputError):
        check_bounds(tmp_path / "self.xml")


def test_a_model_of_a_few_copies_is_left_to_mujoco(tmp_path):
    (tmp_path / "few.xml").write_text(world(f"<replicate count='20'>{GEOM}</replicate>"))
    check_bounds(tmp_path / "few.xml")


def inp(*lines: str) -> str:
    nodes = ("*NODE", "1,0,0,0", "2,1,0,0", "3,1,1,0", "4,0,1,0")
    return "\n".join([*nodes, "*ELEMENT,TYPE=S4", "1,1,2,3,4", *lines, ""])


def test_generated_numbers_that_are_not_there_cost_nothing(tmp_path):
    (tmp_path / "hood.inp").write_text(
        inp("*NSET,NSET=A,GENERATE", "1,1000000000,2", "3,4", "*NSET,NSET=B,GENERATE", "2,4,2")
    )
    mesh = read_mesh_file(tmp_path / "hood.inp")
    np.testing.assert_array_equal(mesh.point_sets["A"], [0, 2, 3])
    np.testing.assert_array_equal(mesh.point_sets["B"], [1, 3])


def test_sets_of_sets_are_gathered_once(tmp_path):
    doubled = [f"*NSET,NSET=S{i}\nS{i + 1},S{i + 1}" for i in range(60)]
    (tmp_path / "hood.inp").write_text(inp(*doubled, "*NSET,NSET=S60", "1,2"))
    mesh = read_mesh_file(tmp_path / "hood.inp")
    np.testing.assert_array_equal(mesh.point_sets["S0"], [0, 1])


def test_sets_that_lie_too_deep_are_refused(tmp_path):
    nested = [f"*NSET,NSET=S{i}\nS{i + 1}" for i in range(3000)]
    (tmp_path / "hood.inp").write_text(inp(*nested, "*NSET,NSET=S3000", "1,2"))
    with pytest.raises(InputError, match="one within the other"):
        read_mesh_file(tmp_path / "hood.inp")


def test_files_that_include_each_other_twice_are_counted(tmp_path):
    for i in range(16):
        (tmp_path / f"i{i}.inp").write_text(f"*INCLUDE,INPUT=i{i + 1}.inp\n" * 2)
    (tmp_path / "i16.inp").write_text(inp())
    with pytest.raises(InputError, match="more than 1000 files"):
        read_mesh_file(tmp_path / "i0.inp")


REFUSED = [
    ("isometric_edc", "tendons.RI.tension", "1 N", "no such tendon; they have EDC, EI, LUM, FPI"),
    (
        "hood_majorflex_edc",
        "tendons.FPI.tension",
        "1 N",
        "they have EDC, LUM, RI, UI",
    ),
    ("cable_edc", "tendons.RI.tension", "1 N", "no such tendon; they have EDC, EI, LUM, FPI"),
    ("pulley_edc", "finger.limit.stiffness", "1e-9 N*m/deg", "must be 1e-4"),
]


@pytest.mark.parametrize(("name", "key", "value", "says"), REFUSED)
def test_what_a_run_would_refuse_is_refused_by_check(name, key, value, says):
    limit = {"half_range": "5 deg", "transition": "1 deg"}
    values = {"finger.limit": limit} if "limit" in key else {}
    with pytest.raises(InputError, match=says):
        check_fit(load_case(name).replace({**values, key: value}))


@pytest.mark.parametrize("name", ["cable_edc", "pulley_edc", "split_edc"])
def test_a_hood_pulls_on_the_tendons_that_its_table_names(name):
    case = load_case(name)
    assert build(case).hood.tendons == case.hood.tendon_names(case.finger.kind)


@pytest.mark.parametrize("finger", ["index", "middle"])
def test_the_ends_of_a_sheet_are_those_of_any_mesh(finger):
    assert {end for end, _ in SHELL_ENDS[finger].values()} == set(ENDS)
