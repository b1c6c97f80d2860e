"""FEBio's files: two fibre families, and fibres stretched in situ."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.job import Job
from fe_solver.job.model import JobOptions, job_model
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import (
    DispersedFamily,
    ExponentialFamily,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
)
from fe_solver.materials.linear import Law, Orthotropic
from fe_solver.q4ans.model import obstacles
from tests.helpers.feb_files import ISOTROPIC, change_section, read, same
from tests.helpers.febio_schema import faults
from tests.helpers.jobs import change_job

TENDON = TransIsoMooneyRivlin(1e6, 2e5, 3e5, 50.0, 9e7, 1.05, 1e9)
TOE = ExponentialFamily(1e5, 40.0, 5e7, 1.04)
CROSSED = CrossedFibres(TENDON, TOE, -0.7)
STRAIGHT = Orthotropic(3e8, 1e7, 0.3, 5e6, 5e6, 4e6)


def with_law(job: Job, law: Law, stretch: float = 1.0) -> Job:
    """Its first part of another law."""
    part = dataclasses.replace(job.sheet.parts[0], law=law, in_situ_stretch=stretch)
    return change_job(job, parts=(part, *job.sheet.parts[1:]), notes=())


@pytest.mark.parametrize(("law", "stretch"), [(CROSSED, 1.0), (TENDON, 1.03), (TENDON, 0.98)])
def test_what_is_written_reads_back(tmp_path: Path, law: Law, stretch: float) -> None:
    job = dataclasses.replace(with_law(read(tmp_path), law, stretch), name="again")
    write_feb(job, tmp_path / "again.feb")
    assert faults(tmp_path / "again.feb") == []
    again = dataclasses.replace(read_feb(tmp_path / "again.feb"), notes=())
    assert obstacles(dataclasses.replace(again, contacts=())) == []
    found, wanted = again.sheet.parts[0].law, job.sheet.parts[0].law
    if isinstance(law, CrossedFibres):
        assert isinstance(found, CrossedFibres)
        assert found.angle == pytest.approx(law.angle)
        again, job = (
            with_law(j, dataclasses.replace(w, angle=0.0))
            for j, w in ((again, found), (job, wanted))
        )
    same(again, job)


@pytest.mark.parametrize(
    ("law", "stretch", "words"),
    [
        (CROSSED, 1.02, "set in_situ_stretch to 1"),
        (STRAIGHT, 1.02, "set in_situ_stretch to 1"),
        (CrossedLinear(STRAIGHT, 1e8, 0.4), 1.0, "no linear material with two fibre families"),
        (
            CrossedFibres(
                HolzapfelGasserOgden(1e5, 1e6, 3.0, 0.1, 0.0, 1e8),
                DispersedFamily(1e6, 3.0, 0.1),
                0.5,
            ),
            1.0,
            "write those as its angle",
        ),
        (CrossedFibres(TENDON, TOE, np.array([[[0.1]], [[0.2]]])), 1.0, "varies within it"),
    ],
)
def test_what_febio_has_not_is_refused_by_name(
    tmp_path: Path, law: Law, stretch: float, words: str
) -> None:
    with pytest.raises(InputError, match=words) as error:
        write_feb(with_law(read(tmp_path), law, stretch), tmp_path / "no.feb")
    assert "'strip'" in str(error.value)


def material(kind: str, inner: str) -> dict[str, str | None]:
    text = f'<material id="1" name="skin" type="{kind}"><density>1</density>{inner}</material>'
    return change_section("Material", ISOTROPIC, text)


MATRIX = '<solid type="Mooney-Rivlin"><c1>1</c1><c2>0</c2></solid>'
LINE = (
    '<solid type="uncoupled fiber-exp-linear"><c3>0.1</c3><c4>40</c4><c5>50</c5><lambda>1.04'
    '</lambda><fiber type="vector">%s</fiber></solid>'
)
AXES = '<k>1000</k><mat_axis type="local">1,2,4</mat_axis>'
MIXED = "uncoupled solid mixture"
TIGHT = (
    '<k>1000</k><elastic type="trans iso Mooney-Rivlin"><c1>1</c1><c2>0</c2><c3>0.1</c3><c4>40</c4>'
    '<c5>50</c5><lam_max>1.04</lam_max><fiber type="local">1,2</fiber></elastic>%s'
)
STRETCHED = '<prestrain type="in-situ stretch"><stretch>1.02</stretch>%s</prestrain>'


def test_a_mixture_of_a_matrix_and_one_or_two_fibres(tmp_path: Path) -> None:
    one = read(tmp_path, material(MIXED, AXES + MATRIX + LINE % "0.6,0.8,0"))
    law = TransIsoMooneyRivlin(1e6, 0.0, 1e5, 40.0, 5e7, 1.04, 1e9)
    assert one.sheet.parts[0].law == law
    two = read(tmp_path, material(MIXED, AXES + MATRIX + LINE % "1,1,0" + LINE % "1,-1,0"))
    crossed = two.sheet.parts[0].law
    assert isinstance(crossed, CrossedFibres)
    assert (crossed.base, crossed.second) == (law, ExponentialFamily(1e5, 40.0, 5e7, 1.04))
    assert crossed.angle == pytest.approx(-np.pi / 2)
    assert one.sheet.fibre[0] @ two.sheet.fibre[0] == pytest.approx(1.4 / np.sqrt(2))


def test_a_stretch_in_situ_is_read_and_thins_nothing(tmp_path: Path) -> None:
    job = read(tmp_path, material("uncoupled prestrain elastic", TIGHT % (STRETCHED % "")))
    assert job.sheet.parts[0].in_situ_stretch == 1.02
    job = dataclasses.replace(job, contacts=())
    options = JobOptions()
    model, plain = (job_model(with_law(job, TENDON, s), options).base for s in (1.02, 1.0))
    cells = np.flatnonzero(job.sheet.part == 0)
    volume, laid = ((m.tables.weight * m.section.thickness)[cells].sum() for m in (model, plain))
    assert volume == pytest.approx(laid)


def test_a_stretch_along_the_fibres_alone_changes_nothing_across(tmp_path: Path) -> None:
    """FEBio's F = diag(s, 1, 1) with `isochoric` 0: growth of 1/s - 1 along the fibres."""
    words = STRETCHED % "<isochoric>0</isochoric>"
    job = read(tmp_path, material("uncoupled prestrain elastic", TIGHT % words))
    part = job.sheet.parts[0]
    assert (part.in_situ_stretch, part.isochoric) == (1.02, False)
    growth = job.sheet.stress_free_growth[job.sheet.part == 0]
    assert growth == pytest.approx(np.tile([1 / 1.02 - 1, 0.0], (len(growth), 1)))
    laid = job.sheet.thickness[job.sheet.part == 0]
    assert job.sheet.section.thickness[job.sheet.part == 0].max() == pytest.approx(laid.max())
    assert any("changes the volume" in reason for reason in obstacles(job))
    write_feb(dataclasses.replace(job, contacts=()), tmp_path / "again.feb")
    assert not read_feb(tmp_path / "again.feb").sheet.parts[0].isochoric


@pytest.mark.parametrize(
    ("kind", "inner", "words"),
    [
        (MIXED, AXES + MATRIX + 3 * (LINE % "1,0,0"), "one or two families in all"),
        (MIXED, AXES + MATRIX, "one or two families in all"),
        (MIXED, AXES + MATRIX + LINE % "1,0,0" + LINE % "0,1,1", "must lie in the sheet"),
        ("uncoupled prestrain elastic", TIGHT % "", "expected <elastic> and <prestrain>"),
        (
            "uncoupled prestrain elastic",
            TIGHT % '<prestrain type="prestrain gradient"/>',
            "an in-situ stretch alone",
        ),
        (
            "prestrain elastic",
            '<elastic type="neo-Hookean"/><prestrain type="in-situ stretch"/>',
            "of trans iso Mooney-Rivlin alone",
        ),
    ],
)
def test_what_is_not_read_is_told(tmp_path: Path, kind: str, inner: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(tmp_path, material(kind, inner))
