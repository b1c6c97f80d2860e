"""What acts in the middle of the sheet, in a file whose nodes lie on a face."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cosim.anatomy.feb import read_feb_mesh
from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.hood.as_job import job_of_hood
from fe_solver.job.model import move_to_mid_surface
from tests.helpers.febio_schema import faults
from tests.helpers.jobs import rod_hood, roped_hood

TENSION = np.array([4.0])


@pytest.mark.parametrize("make", [rod_hood, roped_hood])
def test_what_acts_in_the_middle_reads_back(make, tmp_path):
    """As the same hood's that is written at a face and moved to its middle afterwards."""
    hood, bones = make()
    job, both, springs = job_of_hood(hood, hood.rest, TENSION, bones), [], []
    for name, in_middle in (("face", False), ("middle", True)):
        write_feb(job, path := tmp_path / f"{name}.feb", in_middle=in_middle)
        assert faults(path) == []
        both.append(read_feb(path))
        springs.append({n: pairs[:, 0] for n, pairs in read_feb_mesh(path).lines.items()})
    assert springs[0].keys() == springs[1].keys()
    for name, nodes in springs[0].items():  # of a mesh that is read alone, too
        assert (springs[1][name] == nodes).all()
    face, middle = move_to_mid_surface(both[0]), both[1]
    assert not any("Boundary" in note or "Loads" in note for note in middle.notes)
    np.testing.assert_allclose(middle.sheet.points, face.sheet.points, atol=1e-15)
    assert np.abs(middle.sheet.height).max() < 1e-15
    assert [s.law for s in middle.springs] == [s.law for s in face.springs]
    for s, expected in zip(middle.springs, face.springs, strict=True):
        assert (s.nodes == expected.nodes).all()
        np.testing.assert_allclose(s.length, expected.length, atol=1e-15)
    supports = [[(h.component, *h.nodes) for h in j.held] for j in (middle, face)]
    assert supports[0] == supports[1]
    loads = np.zeros((2, len(job.sheet.points), 3))
    for i, j in enumerate((middle, face)):
        for f in j.forces:
            loads[i, f.nodes] += f.force
    np.testing.assert_allclose(loads[0], loads[1], atol=1e-15)


CONSTRAINED = "<value>0.5</value>"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (CONSTRAINED, "<value>0.4</value>", "a linear constraint is read where"),
        ("<dof>sx</dof>", "<dof>sy</dof>", "a linear constraint is read where"),
        ("<dof>x</dof>", "<dof>x</dof><offset>1</offset>", "a linear constraint is read where"),
        ("<node>1000000</node>", "", "the number of a node"),
        ('type="linear constraint"', 'type="other"', "it lacks an axis"),
    ],
)
def test_a_constraint_of_another_kind_is_refused(old, new, words, tmp_path):
    hood, bones = roped_hood()
    job = job_of_hood(hood, hood.rest, TENSION, bones)
    write_feb(job, path := tmp_path / "middle.feb", in_middle=True)
    text = path.read_text(encoding="utf-8")
    first = text.index('type="linear constraint"')
    if old.startswith("<node>"):
        old = text[text.index("<node>", first) : text.index("</node>", first) + len("</node>")]
    start = text.index(old, first)
    path.write_text(text[:start] + new + text[start + len(old) :], encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read_feb(path)


def test_a_node_that_lies_elsewhere_is_refused(tmp_path):
    hood, bones = roped_hood()
    job = job_of_hood(hood, hood.rest, TENSION, bones)
    write_feb(job, path := tmp_path / "middle.feb", in_middle=True)
    text = path.read_text(encoding="utf-8")
    number = re.search(r'type="linear constraint">\s*<node>(\d+)<', text)[1]
    text = re.sub(rf'(<node id="{number}">)[^,]*', r"\g<1>0.1", text)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="a linear constraint is read where"):
        read_feb(path)


@pytest.mark.parametrize("part", ["nodal_load", "zero displacement", "spring"])
def test_a_file_with_both_faces_and_middle_is_refused(part, tmp_path):
    hood, bones = roped_hood() if part == "spring" else rod_hood()
    job = job_of_hood(hood, hood.rest, TENSION, bones)
    write_feb(job, path := tmp_path / "middle.feb", in_middle=True)
    text = path.read_text(encoding="utf-8")
    match part:
        case "nodal_load":
            text = text.replace("<shell_bottom>1</shell_bottom>", "", 1)
        case "zero displacement":
            held = '<bc node_set="loaded 1" type="zero displacement"><x_dof>1</x_dof></bc>'
            text = text.replace("<Boundary>", f"<Boundary>{held}", 1)
        case _:
            text = re.sub(r"<delem>\d+,", "<delem>1,", text, count=1)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="this acts at a face of the sheet"):
        read_feb(path)
