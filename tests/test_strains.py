"""Strains in numbers: closed forms on a flat strip that is stretched evenly."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.build_shell import HoodLook
from cosim.port import InputError
from cosim.strains import marker_strains, strain_change, strain_summary
from meshes.hood_mesh import MARKER_ROWS, REGIONS, HoodMesh

BAND, TERMINAL = REGIONS.index("central_band"), REGIONS.index("terminal_slip")


def strip() -> HoodMesh:
    """40 x 9 mm along x, its first 32 mm central band, the rest terminal slip."""
    x, y = np.meshgrid(np.linspace(0, 40e-3, 41), np.linspace(-4.5e-3, 4.5e-3, 10), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    corner = (np.arange(40)[:, None] * 10 + np.arange(9)).ravel()
    quads = corner[:, None] + [0, 10, 11, 1]
    region = np.where(points[quads].mean(axis=1)[:, 0] < 32e-3, BAND, TERMINAL)
    fibre = np.tile([1.0, 0, 0], (len(quads), 1))
    return HoodMesh(points, quads, region, fibre, {}, {}, {}, 1e3 * points[:, 0], {}, 42e-3, 5e-4)


def stretched(mesh: HoodMesh, along: float, across: float) -> HoodLook:
    ne, n = len(mesh.quads), len(mesh.points)
    strain = np.tile([(along**2 - 1) / 2, (across**2 - 1) / 2, 0.0], (ne, 1))
    return HoodLook(
        mesh.points * [along, across, 1.0],
        mesh.points,
        mesh.quads,
        mesh.region,
        strain,
        np.zeros((ne, 2)),
        np.zeros((ne, 3)),
        mesh.areas(),
        mesh.cells("central_band"),
        np.zeros(n),
        {},
        {},
        np.zeros(0),
        (),
        np.zeros(0, dtype=int),
        0.0,
        mesh.markers(["central_band"]),
    )


def test_strain_counts_from_free_of_stress_or_from_the_unloaded_state():
    before, now = stretched(strip(), 1.01, 1.002), stretched(strip(), 1.04, 0.97)
    own = strain_summary(now)["strain_percent"]["longitudinal"]
    assert own["mean"] == pytest.approx(100 * (1.04**2 - 1) / 2)
    change = strain_change(before, now)
    ratio = {"longitudinal": 1.04 / 1.01, "lateral": 0.97 / 1.002}
    for direction, r in ratio.items():
        green = change["strain_percent"][direction]
        seen = change["engineering_strain_percent"][direction]
        markers = change["marker_strain_percent"][direction]
        for key in ("min", "mean", "max"):
            assert green[key] == pytest.approx(100 * (r**2 - 1) / 2)
            assert seen[key] == pytest.approx(100 * (r - 1))
            assert markers[key] == pytest.approx(100 * (r - 1))
        slip = change["region_engineering_strain_percent"]["terminal_slip"][direction]
        assert slip["mean"] == pytest.approx(100 * (r - 1))


def test_the_mean_is_over_the_area():
    mesh = strip()
    before, now = stretched(mesh, 1.0, 1.0), stretched(mesh, 1.0, 1.0)
    now.strain[mesh.region == BAND, 0] = np.linspace(0, 0.02, (mesh.region == BAND).sum())
    now.area[mesh.region == BAND] = np.linspace(2.0, 0.0, (mesh.region == BAND).sum())
    mean = strain_change(before, now)["strain_percent"]["longitudinal"]["mean"]
    assert mean == pytest.approx(100 * 0.02 / 3, rel=1e-2)


def test_markers_stand_on_both_edges_and_between_along_the_region():
    mesh = strip()
    markers = mesh.markers(["central_band"])
    place = 1e3 * mesh.points[markers]
    assert markers.shape == (MARKER_ROWS, 3)
    assert place[:, 0, 1] == pytest.approx(4.5)
    assert place[:, 2, 1] == pytest.approx(-4.5)
    assert abs(place[:, 1, 1]).max() <= 0.5
    assert place[:, 1, 0] == pytest.approx(np.linspace(0, 32, MARKER_ROWS), abs=0.5)
    along, across = marker_strains(stretched(mesh, 1, 1), stretched(mesh, 1.1, 1))
    assert (along.shape, across.shape) == ((MARKER_ROWS - 1, 3), (MARKER_ROWS, 2))
    with pytest.raises(InputError, match="central_slip"):
        mesh.markers(["central_slip"])
