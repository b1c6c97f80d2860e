"""The extensor hood as a net of cables: the tendinous rhombus, laid over the bones as line cells.

The net is laid on the hull on which `meshes.hood` lays its sheet, by station (mm along the straight
index finger: MCP 0, PIP 42.6, DIP 67.7) and angle about the chain, and takes from it the tendons'
ends, the insertions, where ligaments are anchored, and the course of the lateral bands.

Where cables begin and end follows the lengths of a published network (Dogadov et al.,
github.com/toxadog/Subito at e59ce5a, initial2.m, middle finger), scaled by the proximal phalanges,
42.6 to 44.63 mm, backwards from the insertions of the sheet.  In mm, there and scaled: extensor
hood along the finger 14.7, 14.0; central band 40, 38.2; central slip 3, 2.9; lateral slip (central
band to lateral band) 38.0, 36.3; medial slip (lateral band to central slip) 32.7, 31.2; lateral
band's last part 13.77, 13.1; terminal slip 10, 9.5; transverse edges of the hood, each half, 11.6
and 9.8, 11.1 and 9.4.  [trial]: an assumption.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cosim.port import Array, Ints
from meshes.hood import (
    INTRINSIC,
    PALMAR_PLATE,
    RETINACULAR_ANCHOR,
    SLIP_REACH,
    clear_guides,
    on_bone,
)
from meshes.hood_lines import (
    CENTRAL_END,
    JOIN,
    LATERAL_END,
    MERGE,
    RETINACULAR_ROWS,
    SAGITTAL_ROWS,
    SLIP_END,
    TERMINAL_END,
)
from meshes.hood_mesh import Attachment
from meshes.hull import CLEARANCE, PIP, Centreline, Hull, Level, SmoothSurface, along
from meshes.skeleton import Skeleton

CABLES = (
    "extensor_tendon",
    "indicis_tendon",
    "intrinsic_tendon",
    "central_band",
    "central_slip",
    "lateral_slip",
    "medial_slip",
    "lateral_band",
    "terminal_slip",
    "hood_edge",
    "sagittal_band",
    "transverse_fibres",
    "triangular_ligament",
)
SIDES = {"radial": 1.0, "ulnar": -1.0}

HOOD_START = -6.0  # SLIP_END less slip, band and hood of the network
HOOD_END = 8.0  # SLIP_END less slip and band; lateral slips leave the central band here
SLIP_START = 46.0  # SLIP_END less the slip; here the rhombus' slips end
INDICIS_END = -11.0  # deg: the middle of the ulnar half of the sheet's central end
# The hood's edge, then the lateral band (station mm, deg).  At the edges as far round as the
# network's transverse edges are long; from the join on the middle of the sheet's lateral band.
LATERAL = np.array(
    [[HOOD_START, 65], [HOOD_END, 77], [JOIN, 94], [24, 71], [PIP, 57], [SLIP_START, 56],
     [SLIP_END, 55], [MERGE, 0]]
)  # fmt: skip
TRANSVERSE = (1.0, *np.linspace(JOIN, SLIP_START, 7))  # every 5.2 mm, and over the MCP [trial]
TRIANGULAR = (54.0, 59.0)  # where the bands are about 7 and 3 mm apart [trial]; the network's: 3 mm
ANGLE = 7.0  # deg about the chain that are about 1 mm, at a radius of some 8 mm


@dataclass(frozen=True)
class CableNet:
    """A net of cables as laid, at `rest_posture` (rad), in the metacarpal frame, m."""

    points: Array
    """(n, 3)."""
    cells: Ints
    """(k, 2)."""
    strand: Ints
    """(k,) index into `strands`."""
    strands: tuple[str, ...]
    """A cable's name, with its side where it has one."""
    ends: Mapping[str, Ints]
    """Loaded ends: central, indicis, radial, ulnar."""
    springs: Mapping[str, Attachment]
    tied: Mapping[str, Ints]
    station: Array
    """(n,) mm, where each node was laid."""
    rest_posture: Mapping[str, float]
    whole: CableNet | None = None
    """The net before its cuts; None is this one."""

    @property
    def cable(self) -> tuple[str, ...]:
        """By strand, the name of its cable, of CABLES."""
        return tuple(cable_of(strand) for strand in self.strands)

    def part_cells(self, name: str) -> Ints:
        """The nodes (m, 2) of a strand's cells; none of a name that is no strand's."""
        return self.cells[np.array([strand == name for strand in self.strands])[self.strand]]

    def lengths(self) -> Array:
        """The cells' lengths (k,) m, as laid."""
        ends = self.points[self.cells]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))

    def strand_lengths(self) -> dict[str, float]:
        """The length of each strand as laid before any cut, m; of ties and edges all their rows
        together."""
        net = self.whole or self
        total = np.bincount(net.strand, weights=net.lengths(), minlength=len(net.strands))
        laid = dict(zip(net.strands, map(float, total), strict=True))
        return {name: laid[name] for name in self.strands}


def cable_of(strand: str) -> str:
    """A strand's name without its side."""
    return strand.removesuffix("_radial").removesuffix("_ulnar")


@dataclass
class _Drawing:
    """Places (station mm, angle deg) as they are first named, and the cells between them."""

    number: dict[tuple[float, float], int] = field(default_factory=dict)
    cells: list[tuple[int, int]] = field(default_factory=list)
    strand: list[str] = field(default_factory=list)

    def node(self, station: float, angle: float) -> int:
        return self.number.setdefault((round(station, 4), round(angle, 4)), len(self.number))

    def line(self, name: str, nodes: list[int]) -> None:
        self.cells += itertools.pairwise(nodes)
        self.strand += [name] * (len(nodes) - 1)

    def course(self, name: str, stations: Array, angles: Array) -> None:
        self.line(name, [self.node(*at) for at in zip(stations, angles, strict=True)])


def _lateral(station: float) -> float:
    """The angles, deg, at which the hood's edge and the lateral band lie at a station (mm)."""
    return float(np.interp(station, *LATERAL.T))


def _stations(spacing: float) -> Array:
    """mm: all places where a cable may begin, end or be tied, and between them evenly."""
    keys = {CENTRAL_END, HOOD_START, HOOD_END, JOIN, SLIP_START, SLIP_END, MERGE, TERMINAL_END}
    keys |= {*TRANSVERSE, *TRIANGULAR}
    breaks = np.array(sorted(keys))
    counts = np.maximum(np.ceil(np.diff(breaks) / spacing - 1e-9).astype(int), 1)
    ends = zip(breaks[:-1], breaks[1:], counts, strict=True)
    rows = [np.linspace(a, b, n, endpoint=False) for a, b, n in ends]
    return np.concatenate([*rows, [TERMINAL_END]])


def _draw(spacing: float) -> _Drawing:
    """The longitudinal cables, then what joins them across."""
    out, rows = _Drawing(), _stations(spacing)

    def straight(name: str, first: tuple[float, float], last: tuple[float, float]) -> None:
        s = rows[(rows > first[0] - 1e-6) & (rows < last[0] + 1e-6)]
        out.course(name, s, np.interp(s, [first[0], last[0]], [first[1], last[1]]))

    straight("extensor_tendon", (CENTRAL_END, 0), (HOOD_END, 0))
    straight("central_band", (HOOD_END, 0), (SLIP_START, 0))
    straight("central_slip", (SLIP_START, 0), (SLIP_END, 0))
    straight("terminal_slip", (MERGE, 0), (TERMINAL_END, 0))
    for side, sign in SIDES.items():
        for name, first, last in (
            ("hood_edge", HOOD_START, HOOD_END),
            ("lateral_band", HOOD_END, MERGE),
        ):
            s = rows[(rows > first - 1e-6) & (rows < last + 1e-6)]
            out.course(f"{name}_{side}", s, sign * np.interp(s, *LATERAL.T))
        straight(f"lateral_slip_{side}", (HOOD_END, 0), (SLIP_START, sign * _lateral(SLIP_START)))
        straight(f"medial_slip_{side}", (JOIN, sign * _lateral(JOIN)), (SLIP_START, 0))
    straight("indicis_tendon", (CENTRAL_END, INDICIS_END), (HOOD_START, 0))
    _tie(out, spacing)
    return out


def _tie(out: _Drawing, spacing: float) -> None:
    """Across the finger from cable to cable, at each row of ties."""
    placed = list(out.number)
    for name, stations, sided in (
        ("sagittal_band", (HOOD_START, HOOD_END), True),
        ("transverse_fibres", TRANSVERSE, True),
        ("triangular_ligament", TRIANGULAR, False),
    ):
        for station in stations:
            angles = sorted(a for s, a in placed if abs(s - station) < 1e-3)
            for a, b in itertools.pairwise(angles):
                count = max(1, round((b - a) / (ANGLE * spacing)))
                side = "radial" if a + b > 0 else "ulnar"
                label = f"{name}_{side}" if sided else name
                out.course(label, np.full(count + 1, station), np.linspace(a, b, count + 1))


def lay(
    skeleton: Skeleton,
    surfaces: Mapping[str, SmoothSurface],
    offset: Mapping[str, float],
    rest_posture: Mapping[str, float],
    spacing: float,
    width: float = 1.0,
) -> CableNet:
    """A net of cells of about `spacing` (m) over bones at `rest_posture` (rad), its centre lines
    `offset` (m) by body over the bare bone; `surfaces` are the scaled bones', `width` scales the
    hand-measured points across the finger."""
    chain = Centreline(skeleton, *skeleton.pose(rest_posture))
    level = Level(surfaces, offset, chain.position, chain.rotation)
    scale = float(skeleton.length[1]) / (PIP * 1e-3)
    drawing = _draw(1e3 * spacing)
    place = np.array(list(drawing.number))
    points = Hull(chain, level).points(place[:, 0], np.deg2rad(place[:, 1]))
    station = place[:, 0]
    clear_guides(points, station, level)
    ends = {
        "central": drawing.node(CENTRAL_END, 0.0),
        "indicis": drawing.node(CENTRAL_END, INDICIS_END),
    }
    for side, (s, dorsal, radial) in INTRINSIC.items():
        up, beside = (1e-3 * width * np.array([v]) for v in (dorsal, radial))
        start = chain.at(np.array([1e-3 * scale * s]), up, beside)
        ends[side] = len(points)
        more = _intrinsic(drawing, side, start, points, spacing)
        points = np.vstack([points, more])
        station = np.append(station, np.linspace(LATERAL_END, JOIN, len(more), endpoint=False))
    terminal = drawing.node(TERMINAL_END, 0.0)
    free = np.setdiff1d(np.arange(len(points)), [*ends.values(), terminal])
    points[free] = level.push_out(points[free], CLEARANCE * 1e-3)
    strands = tuple(dict.fromkeys(drawing.strand))
    return CableNet(
        np.round(points, 7),
        np.array(drawing.cells),
        np.array([strands.index(name) for name in drawing.strand]),
        strands,
        {end: np.array([node]) for end, node in ends.items()},
        _attachments(drawing, chain, level, points, scale, width),
        {"distal": np.array([terminal])},
        np.round(station, 4),
        dict(rest_posture),
    )


def _intrinsic(drawing: _Drawing, side: str, start: Array, points: Array, spacing: float) -> Array:
    """Points (k, 3) of an intrinsic tendon on a straight line from `start` (1, 3) to where it joins
    the lateral band, numbered after `points`."""
    join = drawing.node(JOIN, SIDES[side] * _lateral(JOIN))
    count = max(1, round(float(np.linalg.norm(start - points[join])) / spacing))
    drawing.line(f"intrinsic_tendon_{side}", [*range(len(points), len(points) + count), join])
    f = np.arange(count)[:, None] / count
    return np.asarray((1 - f) * start + f * points[join])


def _attachments(
    drawing: _Drawing, chain: Centreline, level: Level, points: Array, scale: float, width: float
) -> dict[str, Attachment]:
    """What springs hold: central slip and adhesions on the bone under them, sagittal bands and
    retinacular ligaments where those of the sheet are anchored."""
    slip = np.array([drawing.node(SLIP_END, 0.0)])
    reach = SLIP_REACH * 1e-3 * scale * chain.rotation[2][:, 0]
    out = {"central_slip": on_bone("middle", slip, points[slip] + reach, level)}
    for side, sign in SIDES.items():
        join = np.array([drawing.node(JOIN, sign * _lateral(JOIN))])
        out[f"ligament_{side}"] = on_bone("proximal", join, points[join], level)
        for name, rows, (dorsal, radial) in (
            ("sagittal", SAGITTAL_ROWS, PALMAR_PLATE),
            ("retinacular", RETINACULAR_ROWS, RETINACULAR_ANCHOR),
        ):
            held = [
                (s, node)
                for (s, angle), node in drawing.number.items()
                if rows[0] - 1e-6 <= s <= rows[1] + 1e-6 and abs(angle - sign * _lateral(s)) < 1e-3
            ]
            local = np.array([[0.0, sign * radial, dorsal]] * len(held)) * 1e-3 * width
            local[:, 0] = along(chain.skeleton, np.array([s for s, _ in held]))
            nodes = np.array([node for _, node in held])
            out[f"{name}_{side}"] = Attachment("proximal", nodes, np.round(local, 7))
    return out
