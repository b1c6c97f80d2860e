"""Strains in numbers: closed forms on a flat strip that is stretched evenly."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.hoods.shell.gauges import place_gauges
from cosim.hoods.shell.view import (
    ShellView,
    gauge_strains,
    marker_strains,
    strain_change,
    strain_summary,
)
from cosim.results.conventions import is_slack
from meshes.hood_mesh import REGIONS, HoodMesh
from meshes.markers import ROWS, markers

BAND, TERMINAL = REGIONS.index("central_band"), REGIONS.index("terminal_slip")


def strip(rows: int = 40) -> HoodMesh:
    """40 x 9 mm along x, its first 32 mm or nearly so central band, the rest terminal slip."""
    x, y = np.linspace(0, 40e-3, rows + 1), np.linspace(-4.5e-3, 4.5e-3, 10)
    x, y = np.meshgrid(x, y, indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    corner = (np.arange(rows)[:, None] * 10 + np.arange(9)).ravel()
    quads = corner[:, None] + [0, 10, 11, 1]
    region = np.where(points[quads].mean(axis=1)[:, 0] < 32e-3, BAND, TERMINAL)
    fibre = np.tile([1.0, 0, 0], (len(quads), 1))
    return HoodMesh(points, quads, region, fibre, {}, {}, {}, 1e3 * points[:, 0], {}, 42e-3, 5e-4)


def stretch(mesh: HoodMesh, along: float, across: float) -> ShellView:
    ne, n = len(mesh.quads), len(mesh.points)
    strain = np.tile([(along**2 - 1) / 2, (across**2 - 1) / 2, 0.0], (ne, 1))
    return ShellView(
        points=mesh.points * [along, across, 1.0],
        reference=mesh.points,
        quads=mesh.quads,
        region=mesh.region,
        strain=strain,
        line_strain=strain,
        fibres=np.zeros((0, ne, 3)),
        tension=np.full(ne, -1),
        fibre_stretch=np.full(ne, along),
        beyond_straight=np.full(ne, along / 1.03),
        faces=np.zeros((ne, 2)),
        stress=np.zeros((ne, 3)),
        energy_density=np.zeros(ne),
        volume=5e-4 * mesh.areas(),
        thickness_stretch=np.ones(ne),
        area=mesh.areas(),
        central=mesh.cells("central_band"),
        pressure=np.zeros(n),
        spring_force={},
        spring_tension=np.zeros(0),
        spring_set=(),
        spring_node=np.zeros(0, dtype=int),
        penetration=0.0,
        compression=None,
        guide_depth=0.0,
        unstable_modes=0,
        glide={},
        band_height={},
        gauges=place_gauges({}, {}, np.zeros((0, 3)), np.zeros((0, 3), dtype=int)),
        markers=markers(mesh, ["central_band"]),
        region_force={},
        strip_arm={},
        ropes={},
        iterations=0,
        attempt="",
    )


def test_a_region_s_fibres_are_strained_by_their_stretch_and_beyond_straight():
    found = strain_summary(stretch(strip(), 1.04, 0.97))["fibre_strain_percent"]
    assert set(found) == {"central_band", "terminal_slip"}
    for strain in found.values():
        assert [strain[key] for key in ("p5", "mean", "p95")] == pytest.approx([4.0] * 3)
        assert strain["beyond_straight"] == pytest.approx(100 * (1.04 / 1.03 - 1))


def test_strain_counts_from_free_of_stress_or_from_the_unloaded_state():
    before, now = stretch(strip(), 1.01, 1.002), stretch(strip(), 1.04, 0.97)
    own = strain_summary(now)["strain_percent"]["longitudinal"]
    assert own["mean"] == pytest.approx(100 * (1.04**2 - 1) / 2)
    change = strain_change(before, now)
    ratio = {"longitudinal": 1.04 / 1.01, "lateral": 0.97 / 1.002}
    for direction, r in ratio.items():
        green = change["strain_percent"][direction]
        seen = change["engineering_strain_percent"][direction]
        markers = change["marker_strain_percent"][direction]
        slip = change["region_engineering_strain_percent"]["terminal_slip"][direction]
        for key in ("min", "mean", "max"):
            assert markers[key] == pytest.approx(100 * (r - 1))
        for key in ("p5", "mean", "p95"):
            assert green[key] == pytest.approx(100 * (r**2 - 1) / 2)
            assert seen[key] == pytest.approx(100 * (r - 1))
            assert slip[key] == pytest.approx(100 * (r - 1))


def test_percentiles_are_over_the_area_and_no_single_quad_makes_them():
    found = []
    for rows in (40, 120):
        look = stretch(strip(rows), 1.0, 1.0)
        band = np.flatnonzero(look.region == BAND)
        place = look.points[look.quads[band]].mean(axis=1)[:, 0]
        look.strain[band, 0] = 0.02 * place / 32e-3  # even from 0 to 2 %
        look.area[band] *= np.where(place > 16e-3, 3.0, 1.0)  # of which 1 to 2 % has three quarters
        look.strain[band[-1], 0] = 1.0  # one quad gone wild
        found.append(strain_summary(look)["region_strain_percent"]["central_band"]["longitudinal"])
    for spread in found:
        assert spread["p5"] == pytest.approx(0.2, abs=0.02)
        assert spread["p95"] == pytest.approx(2 - 0.05 * 4 / 3, abs=0.05)


def test_the_mean_is_over_the_area():
    mesh = strip()
    before, now = stretch(mesh, 1.0, 1.0), stretch(mesh, 1.0, 1.0)
    now.strain[mesh.region == BAND, 0] = np.linspace(0, 0.02, (mesh.region == BAND).sum())
    now.area[mesh.region == BAND] = np.linspace(2.0, 0.0, (mesh.region == BAND).sum())
    mean = strain_change(before, now)["strain_percent"]["longitudinal"]["mean"]
    assert mean == pytest.approx(100 * 0.02 / 3, rel=1e-2)


def test_a_gauge_reads_what_is_about_its_marker_on_any_mesh():
    """A strain that grows along the strip; a spike in one quad weighs as little as the quad."""
    read = []
    for rows in (40, 120):
        mesh = strip(rows)
        look = stretch(mesh, 1.0, 1.0)
        place = mesh.points[mesh.quads].mean(axis=1)[:, 0]
        look.strain[:, 0] = place
        inner = gauge_strains(look.strain, look)[:, 0].reshape(ROWS, 3)[1:-1]
        assert inner == pytest.approx(look.markers.at(mesh.points)[1:-1, :, 0], rel=2e-3)
        own = strain_summary(look)["strain_percent"]["longitudinal"]
        spike = int(np.argmin(place))
        look.strain[spike, 0] -= 1e-5 / look.area[spike]
        read.append((own["min"], own["max"], strain_summary(look)["strain_percent"]))
    (low, high, spiked), (again_low, again_high, again) = read
    assert (low, high) == pytest.approx((again_low, again_high), abs=0.02)
    spikes = [s["longitudinal"]["min"] for s in (spiked, again)]
    assert spikes[0] == pytest.approx(spikes[1], rel=0.05)
    assert spikes[0] < low - 1.0


def test_a_slip_is_slack_that_bears_next_to_nothing_of_both():
    assert is_slack({"central": 0.0, "terminal": 0.0}, "central")
    assert is_slack({"central": 0.5, "terminal": 9.6}, "central")
    assert not is_slack({"central": 0.6, "terminal": 10.0}, "central")


@pytest.mark.parametrize("cells", [40, 26])
def test_markers_stand_on_both_edges_and_between_along_the_region(cells):
    mesh = strip(cells)
    glued = markers(mesh, ["central_band"])
    place = 1e3 * glued.at(mesh.points)
    assert place.shape == (ROWS, 3, 3)
    end = 1e3 * mesh.points[np.unique(mesh.quads[mesh.cells("central_band")]), 0].max()
    rows = np.linspace(0, end, ROWS)
    for column, y in enumerate((4.5, 0.0, -4.5)):
        assert place[:, column, 0] == pytest.approx(rows, abs=1e-9)
        assert place[:, column, 1] == pytest.approx(y, abs=1e-9)
    assert glued.weight.sum(axis=2) == pytest.approx(1.0)
    along, across = marker_strains(stretch(mesh, 1, 1), stretch(mesh, 1.1, 1))
    assert (along.shape, across.shape) == ((ROWS - 1, 3), (ROWS, 2))
    with pytest.raises(InputError, match="central_slip"):
        markers(mesh, ["central_slip"])


def test_markers_begin_where_a_ragged_end_has_its_width():
    mesh = strip()
    mesh.station[0] -= 0.4
    place = 1e3 * markers(mesh, ["central_band"]).at(mesh.points)
    assert np.ptp(place[:, :, 1], axis=1) == pytest.approx(9.0)
    assert 0 <= place[0, 1, 0] < 0.5
