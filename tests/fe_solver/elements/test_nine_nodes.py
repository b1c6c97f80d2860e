"""The order of a nine-node quad: ours, VTK's by its name, and no other in silence."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from fe_solver.elements.mesh_geometry import check_middles
from fe_solver.elements.mitc9 import IN_TURN, NODES
from fe_solver.job.job import Job, NodalForce
from fe_solver.job.solve import solve_job
from fe_solver.materials.linear import Isotropic
from fe_solver.sheet import even_sheet, quads_from_vtk
from fe_solver.supports import WALL, Tied
from tests.proofs.fe.sheets import elements

ORDERS = list(permutations(range(4, 9)))[1:]


def parallelogram(aspect: float, skew: float, bow: float) -> np.ndarray:
    """Nodes (9, 3) of an element, with one side at `skew` degrees off the square, rolled up by
    `bow` rad."""
    turn = np.radians(skew)
    flat = NODES @ np.array([[aspect, 0.0], [np.sin(turn), np.cos(turn)]])
    bent = bow / (2 * max(aspect, 1.0)) * flat[:, 0]
    radius = 2 * max(aspect, 1.0) / bow
    return np.column_stack([radius * np.sin(bent), flat[:, 1], radius * (1 - np.cos(bent))])


@given(
    aspect=st.floats(0.1, 10),
    skew=st.floats(-50, 50),
    bow=st.floats(0.01, 1.0),
    order=st.sampled_from(ORDERS),
)
def test_middles_in_any_other_order_are_refused(
    aspect: float, skew: float, bow: float, order: tuple[int, ...]
) -> None:
    X = parallelogram(aspect, skew, bow)
    own = np.arange(9)[None]
    check_middles(X, own, str)
    check_middles(X, quads_from_vtk(own[:, IN_TURN]), str)
    for wrong in (own[:, IN_TURN], np.array([[0, 1, 2, 3, *order]])):
        with pytest.raises(InputError, match=r"0: its node \d does not lie .*quads_from_vtk"):
            check_middles(X, wrong, str)


@pytest.mark.parametrize("shift", [0.55, -0.55])
@pytest.mark.parametrize("middle", [4, 5, 6, 7, 8])
def test_a_middle_beyond_the_corners_is_refused(middle: int, shift: float) -> None:
    X = parallelogram(1.0, 0.0, 0.01)
    X[middle] += 2 * shift * (np.array([0, 1, 0]) if middle < 6 else np.array([1, 0, 0]))
    with pytest.raises(InputError, match=r"its node \d does not lie"):
        check_middles(X, np.arange(9)[None], str)


def strip(quads: np.ndarray, points: np.ndarray) -> float:
    """Deflection (m) of the end of a cantilever of 20 x 5 x 0.5 mm under 1 mN, over the beam's."""
    sheet = even_sheet(points, quads, Isotropic(100e6, 0.0), 0.5e-3)
    end = sheet.edge("x1")
    load = NodalForce(end, (0, 0, 1e-3 / len(end)))
    job = Job(sheet, ties=[Tied(sheet.edge("x0"), WALL)], forces=[load])
    x = solve_job(job).states[-1].configuration.x
    return float(x[end, 2].mean() / (1e-3 * 20e-3**3 / (3 * 100e6 * 5e-3 * 0.5e-3**3 / 12)))


def test_a_mesh_of_vtk_bends_as_a_beam_by_name_and_is_refused_without() -> None:
    uv, quads = elements(4, 2, 9)
    points = np.column_stack([uv * [20e-3, 5e-3], 0 * uv[:, 0]])
    vtk = quads[:, IN_TURN]
    assert strip(quads_from_vtk(vtk), points) == pytest.approx(1, abs=0.01)
    for wrong in (vtk, vtk[:, ::-1]):
        with pytest.raises(InputError, match=r"element 0 .*does not lie between|area|corner|wound"):
            strip(wrong, points)
        with pytest.raises(InputError, match="element 0"):
            even_sheet(points, wrong, Isotropic(100e6, 0.0), 0.5e-3).model()
    with pytest.raises(InputError, match=r"nine nodes \(ne, 9\), got"):
        quads_from_vtk(quads[:, :4])
