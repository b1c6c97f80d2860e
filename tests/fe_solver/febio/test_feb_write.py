"""FEBio's files: what is written reads back."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import Drive, Extension, Interpolation, LoadCurve
from fe_solver.job.job import HeldDirector, Job, NodalForce, PrescribedDisplacement, Pressure, Step
from fe_solver.materials.fibres import HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Law, Orthotropic
from fe_solver.sheet import Sheet, ShellPart
from fe_solver.supports import Body, ContactPair, SpringLaw, SpringSet, Tied
from tests.helpers.feb_files import change_section, read, same
from tests.helpers.febio_schema import faults
from tests.helpers.jobs import change_job

INTS = np.array
SLACK = np.array([1e-4, 2e-4])


def test_a_file_written_reads_back_as_the_same_job(tmp_path: Path) -> None:
    job = dataclasses.replace(read(tmp_path), name="again", notes=())
    write_feb(job, tmp_path / "again.feb")
    assert faults(tmp_path / "again.feb") == []
    same(dataclasses.replace(read_feb(tmp_path / "again.feb"), notes=()), job)
    assert [p.name for p in tmp_path.iterdir() if p.suffix == ".part"] == []


finite = st.floats(-10, 10, allow_nan=False).map(lambda x: round(x, 6))
positive = st.floats(0.1, 10).map(lambda x: round(x, 6))


@st.composite
def curves(draw: st.DrawFn) -> LoadCurve:
    n = draw(st.integers(1, 5))
    gaps = draw(st.lists(positive, min_size=n, max_size=n))
    values = draw(st.lists(finite, min_size=n, max_size=n))
    how, beyond = draw(st.sampled_from(Interpolation)), draw(st.sampled_from(Extension))
    return LoadCurve(tuple(np.cumsum(gaps).tolist()), tuple(values), how, beyond)


drives = st.builds(Drive, positive, st.none() | curves())
three = st.lists(finite, min_size=3, max_size=3).map(np.array)


@st.composite
def laws(draw: st.DrawFn) -> Law:
    E = draw(positive) * 1e6
    return draw(
        st.sampled_from(
            [
                Isotropic(E, 0.3),
                NeoHookean(E, 0.4),
                TransIsoMooneyRivlin(E, 0.0, E / 3, 50.0, 9 * E, 1.05, 100 * E),
                HolzapfelGasserOgden(E, 2 * E, 3.0, 0.2, 0.5, 90 * E),
                Orthotropic(3 * E, E, 0.2, E / 2, E / 3, E / 4, E / 2, 0.1, 0.2),
            ]
        )
    )


NAMES = ("bone", 'a "b" <c> & d', "Ä 1", "x/y")


@st.composite
def jobs(draw: st.DrawFn) -> Job:
    """A sheet of n by 2 quads with a triangle of its own part, and one of every condition."""
    n = draw(st.integers(1, 3))
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(3.0))
    points = np.column_stack([x.ravel(), y.ravel(), 0.1 * (x * y).ravel()]) * 1e-3
    points = np.concatenate([points, [[-1e-3, 0.5e-3, 0]]])
    first = np.array([i + j * (n + 1) for j in range(2) for i in range(n)])
    quads = np.column_stack([first, first + 1, first + n + 2, first + n + 1])
    quads = np.concatenate([quads, [[0, n + 1, len(points) - 1, len(points) - 1]]])
    thickness = np.full((len(quads), 4), 1e-4)
    thickness[0] *= draw(positive)
    thickness[-1] = 2e-4
    corner = np.arange(4)
    body = Body(
        draw(st.sampled_from(NAMES)),
        draw(three) * 1e-3,
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]) * 1e-3,
        np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
        (draw(drives), Drive(), draw(drives)),
        (Drive(), draw(drives), Drive()),
    )
    other = dataclasses.replace(body, name="other", displacement=(Drive(),) * 3)
    node = st.integers(0, len(points) - 1)
    springs = SpringSet(
        "string",
        SpringLaw(draw(positive) * 1e3, draw(st.booleans())),
        INTS([0, 1, 2]),
        INTS([0, 1, -1]),
        np.array([body.vertices[1], draw(three) * 1e-3 + 5e-3, [0, 0, 0]]),
        INTS([-1, -1, 0]),
        np.zeros(3),
    )
    far = [body.origin + springs.anchor[0], other.origin + springs.anchor[1], points[0]]
    springs = dataclasses.replace(springs, length=np.linalg.norm(far - points[:3], axis=1))
    law = draw(laws())
    ends = np.cumsum(draw(st.lists(positive, min_size=1, max_size=3))).tolist()
    quads_in = np.arange(len(quads))
    fibre = np.tile([1.0, 0, 0], (len(quads), 1))
    edge = points[quads[:, 1]] - points[quads[:, 0]]
    plain = isinstance(law, Isotropic | NeoHookean)
    along = edge / np.linalg.norm(edge, axis=1, keepdims=True)
    numbers = st.permutations(range(1, len(points) + 1)).map(sorted).map(np.array)
    sheet = Sheet(
        points,
        quads,
        (
            ShellPart("sheet", law),
            ShellPart(draw(st.sampled_from(["tip", "é & <x>"])), Isotropic(1e6, 0.3)),
        ),
        np.where(quads_in < len(quads) - 1, 0, 1),
        thickness,
        np.where((plain | (quads_in == len(quads) - 1))[:, None], along, fibre),
        -thickness / 2,
        node_ids=draw(numbers) + draw(st.integers(0, 9)),
        element_ids=quads_in + draw(st.integers(1, 50)),
    )
    two = INTS([0, len(quads) - 1])
    return Job(
        sheet,
        ties=(Tied(corner[:2] + n, 1, draw(st.booleans())),),
        held=(
            PrescribedDisplacement(INTS([0]), 0),
            PrescribedDisplacement(INTS([0]), 1),
            PrescribedDisplacement(INTS([0]), 2, draw(drives)),
        ),
        held_directors=(HeldDirector(INTS([0]), 1),),
        springs=(springs,),
        forces=(NodalForce(INTS([draw(node)]), draw(three), draw(st.none() | curves())),),
        pressures=(Pressure(two, INTS([1, -1]), draw(drives), draw(st.booleans())),),
        contacts=(
            ContactPair(
                "touch <&>",
                quads_in,
                np.full(len(quads), draw(st.sampled_from([1, -1]))),
                0,
                body.triangles,
                draw(positive),
                draw(st.booleans()),
                draw(st.sampled_from([0.0, 0.4])),
                draw(st.sampled_from([0.0, 1e-5])),
            ),
        ),
        bodies=(body, other),
        steps=tuple(
            Step(f"s{i}" if len(ends) > 1 else "step 1", e, draw(st.integers(1, 4)))
            for i, e in enumerate(ends)
        ),
    )


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(jobs(), st.sampled_from([1e-3, 1.0, 0.0254]), st.sampled_from([1.0, 1e-3]))
def test_any_job_reads_back(tmp_path: Path, job: Job, length: float, force: float) -> None:
    path = tmp_path / "job.feb"
    write_feb(job, path, length_unit=length, force_unit=force)
    assert faults(path) == []
    back = read_feb(path, length_unit=length, force_unit=force)
    same(dataclasses.replace(back, notes=()), job)


def test_slack_springs_become_tables(tmp_path: Path) -> None:
    """FEBio's springs rest at their initial length: another one is a table in elongation."""
    job = read(tmp_path)
    for only in (True, False):
        s = dataclasses.replace(
            job.springs[0], law=SpringLaw(7e3, only), length=job.springs[0].length + SLACK
        )
        write_feb(dataclasses.replace(job, springs=(s,)), tmp_path / "slack.feb")
        assert faults(tmp_path / "slack.feb") == []
        back = read_feb(tmp_path / "slack.feb").springs
        assert [len(b.nodes) for b in back] == [1, 1]
        for b, slack, rest in zip(back, SLACK, job.springs[0].length, strict=True):
            np.testing.assert_allclose(b.length, rest)
            for stretch in (-3e-4, 0.0, slack, 2.5e-4, 7e-4):
                expected = s.law.force(stretch - slack)
                assert b.law.force(stretch) == pytest.approx(expected, abs=1e-9)


def test_nodes_on_the_mid_surface_are_moved_to_febios_face(tmp_path: Path) -> None:
    job = read(tmp_path, {"MeshData": None, **change_section("MeshDomains", "0.25", "0.5")})
    flat = change_job(job, height=np.zeros_like(job.sheet.height))
    write_feb(flat, tmp_path / "face.feb")
    back = read_feb(tmp_path / "face.feb")
    np.testing.assert_allclose(
        back.sheet.points - job.sheet.points, np.tile([0, 0, 2.5e-4], (7, 1)), atol=1e-12
    )


def test_other_points_are_written_in_place_of_the_jobs(tmp_path: Path) -> None:
    job = read(tmp_path)
    write_feb(job, tmp_path / "moved.feb", points=job.sheet.points + 1e-3)
    np.testing.assert_allclose(
        read_feb(tmp_path / "moved.feb").sheet.points, job.sheet.points + 1e-3
    )
    with pytest.raises(InputError, match="shape"):
        write_feb(job, tmp_path / "moved.feb", points=job.sheet.points[1:])


def test_what_febio_cannot_say_is_not_written(tmp_path: Path) -> None:
    job, path = read(tmp_path), tmp_path / "no.feb"
    endless = ShellPart("strip", TransIsoMooneyRivlin(1e6, 0.0, 0.0, 1.0, 0.0, 2.0))
    twins = (job.sheet.parts[0], dataclasses.replace(job.sheet.parts[1], name="strip"))
    mixed = dataclasses.replace(job.contacts[0], side=INTS([1, -1]))
    for changes, words in (
        ({"parts": (endless, job.sheet.parts[1])}, "finite bulk modulus"),
        ({"parts": twins}, "are called 'strip'"),
        ({"contacts": (mixed,)}, "one face"),
        ({"steps": ()}, "no time steps"),
        (
            {"parts": (dataclasses.replace(job.sheet.parts[0], name="\x01"), job.sheet.parts[1])},
            "control char",
        ),
    ):
        with pytest.raises(InputError, match=words):
            write_feb(change_job(job, **changes), path)
    assert not path.exists()
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        write_feb(job, tmp_path / "file" / "x.feb")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<v>0.4</v>", "<nu>0.4</nu>", "Element material"),
        ("<E>100.0</E>", "<E>1e</E>", "Element E"),
        ('lc="1"', 'lc="7"', "there is no ..7"),
        ("sliding-elastic", "sliding elastic", "contact"),
        ('node_set="held 1"', 'node_set="held 9"', "there is no ..held 9"),
        ('<elem id="2">2,3,6,5', '<elem id="2">2,3,6,55', "there is no node ..55"),
        ("ShellDomain", "SolidDomain", "SolidDomain"),
    ],
)
def test_the_schema_of_febios_documentation_finds_faults(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    path = tmp_path / "again.feb"
    write_feb(read(tmp_path), path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    assert re.search(words, " ".join(faults(path)))
