"""The shell solver against closed forms, published problems and itself."""

from __future__ import annotations

import pytest

from tests.proofs.fe import (
    benchmarks_linear,
    benchmarks_nonlinear,
    contact_rows,
    element_rows,
    fibre_rows,
    free_bodies,
    hood_rows,
    manufactured_rows,
    material_rows,
    peers,
    shear_lag,
    tangent_rows,
    thread_rows,
)
from tests.proofs.fe.beams import CURVED, HOOK, STRAIGHT_BEAMS
from tests.proofs.fe.benchmark import Benchmark, rows_of
from tests.proofs.fe.limit_loads import HINGED_ROOFS, STRIP_BUCKLING
from tests.proofs.fe.membranes import BALLOON, HENCKY
from tests.proofs.fe.obstacle_course import (
    COOK,
    HEMISPHERES,
    HYPERBOLIC_PARABOLOIDS,
    PINCHED_CYLINDER,
    RANDOM_MESHES,
    ROOF,
    TWISTED_BEAMS,
)
from tests.proofs.fe.tension_fields import ANNULUS, BENT_RECTANGLES, SHEAR_WEB

BENCHMARKS: dict[str, tuple[Benchmark, ...]] = {
    "straight beam": STRAIGHT_BEAMS,
    "curved beam": (CURVED,),
    "hook": (HOOK,),
    "hyperbolic paraboloid": HYPERBOLIC_PARABOLOIDS,
    "roof": (ROOF,),
    "pinched cylinder": (PINCHED_CYLINDER,),
    "Cook's membrane": (COOK,),
    "random meshes": RANDOM_MESHES,
    "twisted beam": TWISTED_BEAMS,
    "hemisphere, linear": HEMISPHERES,
    "hinged roofs": HINGED_ROOFS,
    "sideways buckling": (STRIP_BUCKLING,),
    "membranes": (HENCKY, BALLOON),
    "tension field": (SHEAR_WEB, ANNULUS, *BENT_RECTANGLES),
}
"""What both elements solve."""
QUICK = ("curved beam", "roof", "Cook's membrane", "random meshes", "twisted beam")
ENDLESS = "pinched cylinder"
"""Under its point loads a shell that shears gives way without bound: no finer mesh is judged."""


def case(name: str) -> object:
    return pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow])


@pytest.mark.parametrize("name", [case(name) for name in BENCHMARKS])
def test_benchmark(judge, name):
    judge(rows_of(*BENCHMARKS[name])())


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in BENCHMARKS if name != ENDLESS])
def test_benchmark_on_a_finer_mesh(judge, name):
    judge(rows_of(*(b.refine() for b in BENCHMARKS[name]))())


@pytest.mark.slow
def test_element(judge):
    judge(element_rows.rows())


def test_tangents(judge):
    judge(tangent_rows.rows())


def test_materials(judge):
    rows = judge(material_rows.rows())
    assert len({(r.name, r.quantity) for r in rows}) == len(rows)


@pytest.mark.slow
def test_manufactured_solutions(judge):
    judge(manufactured_rows.element_rows())


@pytest.mark.slow
def test_manufactured_solutions_of_every_material(judge):
    judge(manufactured_rows.material_rows())


def test_crossed_and_stretched_fibres(judge):
    judge(fibre_rows.rows())


def test_contact(judge):
    judge(contact_rows.rows())


@pytest.mark.slow
def test_hood(judge):
    judge(hood_rows.rows())


@pytest.mark.slow
def test_threads(judge):
    judge(thread_rows.rows())


@pytest.mark.parametrize("solve", free_bodies.ELEMENTS)
def test_free_bodies_and_single_steps(judge, solve):
    judge(free_bodies.rows(solve))


def test_plate(judge):
    judge(benchmarks_linear.plate_rows())


def test_tapered_cantilever(judge):
    judge(benchmarks_linear.taper_rows())


def test_eccentric_strip(judge):
    judge(benchmarks_linear.eccentric_rows())


def test_folded_cantilever(judge):
    judge(benchmarks_linear.bracket_rows())


def test_shear_lag(judge):
    judge(shear_lag.rows())


def test_end_shear(judge):
    judge(benchmarks_nonlinear.shear_rows())


@pytest.mark.slow
def test_end_shear_on_nine_node_elements(judge):
    judge(benchmarks_nonlinear.END_SHEAR.rows())


def test_end_moment(judge):
    judge(benchmarks_nonlinear.moment_rows())


@pytest.mark.slow
def test_hemisphere_nonlinear(judge):
    judge(benchmarks_nonlinear.hemisphere_rows())


@pytest.mark.slow
def test_open_cylinder(judge):
    judge(benchmarks_nonlinear.open_cylinder_rows())


@pytest.mark.slow
def test_slit_ring(judge):
    judge(benchmarks_nonlinear.ring_rows())


@pytest.mark.slow
def test_half_cylinder(judge):
    judge(benchmarks_nonlinear.half_cylinder_rows())


@pytest.mark.slow
def test_large_deflections_on_nine_node_elements(judge):
    judge(rows_of(*benchmarks_nonlinear.NINE_NODE_PATHS)())


@pytest.mark.slow
@pytest.mark.skipif(not peers.is_installed(), reason="KratosMultiphysics not installed")
def test_peers(judge):
    judge(peers.rows())
