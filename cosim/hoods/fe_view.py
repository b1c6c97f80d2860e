"""What any hood of finite elements shows: its shape, what its springs and slips bear, and whether
the lines on which its tendons' ends slide clear the bone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from cosim.hoods.lesion import SLIPS
from cosim.hoods.view import Field
from cosim.port import Array, State
from fe_solver.forces.contact import coulomb_defects
from fe_solver.forces.springs import (
    Axial,
    node_spring_directions,
    node_spring_state,
    spring_directions,
    spring_state,
)
from fe_solver.hood.build import heights
from fe_solver.hood.shell_hood import RETRIES
from fe_solver.hood.shell_hood import ShellHood as FeHood
from fe_solver.solver.newton_step import factorise
from meshes.bands import HoodLine, band_heights
from meshes.glide import CarriedPoint, glide, tendon_shift
from meshes.hull import lines_to_joint

REPAIRS = ("suture_", "graft_")
"""How the spring sets of repairs are called, before the part or the user's name."""
MUSCLE = 20e-3
"""m, how far a tendon is drawn proximally of its eyelet."""


@dataclass(frozen=True, kw_only=True)
class FeView:
    """What there is to see of a solved hood of finite elements, be it a sheet or a net."""

    points: Array
    """(n, 3) m, deformed."""
    reference: Array
    """(n, 3) m, as laid."""
    spring_force: Mapping[str, float]
    """N, magnitude of each spring set's summed force."""
    spring_tension: Array
    """(ns,) N of every spring."""
    spring_set: tuple[str, ...]
    """(ns,) the set it is of."""
    spring_node: np.ndarray
    """(ns,) node of the hood that it holds."""
    penetration: float
    """m, the deepest under the level of contact."""
    compression: float | None
    """The largest share of its thickness by which the tissue under it is compressed; None of a
    penalty."""
    guide_depth: float
    """m, of `guide_depth`."""
    unstable_modes: int
    """In how many ways the hood would leave its equilibrium with bones and tensions held: the
    negative pivots of its tangent."""
    glide: Mapping[str, float]
    """m by place, of `meshes.glide`, positive distally."""
    band_height: Mapping[str, float]
    """m by side, of the lateral bands over the PIP's axis (`meshes.bands`), positive dorsally."""
    tendon_shift: float | None = None
    """m that the extensor tendon lies radial, over the MCP, of where it was laid; None without."""
    ropes: Mapping[str, Array]
    """(3, 3) m by tendon, of `rope_lines`."""
    iterations: int
    """Newton iterations since the hood's start."""
    attempt: str
    """Which attempt of the solver converged here, in words."""
    friction: Mapping[str, float] = field(default_factory=dict)
    """What `friction_audit` says; empty of a hood without friction."""
    repair_force: Mapping[str, float] = field(default_factory=dict)
    """N, the tensions of each suture and graft together."""

    def lines(self) -> Mapping[str, Array]:
        """What pictures draw of it as lines (k, 3) m, by name."""
        return self.ropes

    def fields(self) -> tuple[Field, ...]:
        """What sheet and net share."""
        glide = np.array(list(self.glide.values()))
        line = "tendon of the hood beyond its mesh, from the middle of its end over its eyelet"
        dims = ("line_tendon", "line_point", "axis")
        ropes = [Field("tendon_line", dims, "m", line, np.array(list(self.ropes.values())))]
        return (
            *(ropes if self.ropes else ()),
            Field("node", ("point", "axis"), "m", "hood node", self.points),
            Field("spring_force", ("spring",), "N", "tension of the spring", self.spring_tension),
            Field(
                "glide",
                ("place",),
                "m",
                "glide of the hood along the bone beneath, from where it was laid, distally",
                glide,
            ),
            Field(
                "displacement",
                ("point", "axis"),
                "m",
                "from where it was laid",
                self.points - self.reference,
                in_results=False,
                on_mesh=True,
            ),
        )

    def coordinates(self) -> Mapping[str, Any]:
        return {
            "place": list(self.glide),
            **({"line_tendon": list(self.ropes)} if self.ropes else {}),
            "spring_set": ("spring", list(self.spring_set)),
            "spring_node": ("spring", self.spring_node),
        }

    def own_summary(self) -> Mapping[str, Any]:
        """What sheet and net do not share."""
        return {}

    def summary(self) -> Mapping[str, Any]:
        heights = {side: 1e3 * z for side, z in self.band_height.items() if np.isfinite(z)}
        return {
            "glide_mm": {place: 1e3 * glide for place, glide in self.glide.items()},
            **({"lateral_band_height_mm": heights} if heights else {}),
            **({} if self.tendon_shift is None else {"tendon_shift_mm": 1e3 * self.tendon_shift}),
            "spring_force_N": dict(self.spring_force),
            **({"repair_force_N": dict(self.repair_force)} if self.repair_force else {}),
            **self.own_summary(),
            **self.audit(),
            **({"hood_solved": self.attempt} if self.attempt in RETRIES else {}),
        }

    def pressed(self) -> Mapping[str, float]:
        """How deep the hood presses into what it lies on."""
        depth = 1e3 * self.penetration
        if self.compression is None:
            return {"max_penetration_mm": depth}
        return {"max_compression_mm": depth, "layer_used_up": self.compression}

    def audit(self) -> Mapping[str, float]:
        return {
            **self.pressed(),
            "guide_depth_mm": 1e3 * self.guide_depth,
            "hood_unstable_modes": self.unstable_modes,
            **self.friction,
        }

    def change(self, before: Any) -> Mapping[str, Any]:
        return {}


@dataclass(frozen=True)
class Lines:
    """Where a hood is looked at, whatever its state."""

    places: Sequence[CarriedPoint]
    """Where the glide is measured."""
    bands: Mapping[str, HoodLine]
    """The lateral bands' middle lines, by side."""
    axis: Array
    """(3,) unit, the PIP's in the middle phalanx's frame."""
    mcp: CarriedPoint | None = None
    """The extensor tendon over the MCP."""


def view_at(hood: FeHood, depth: float, lines: Lines, state: State) -> FeView:
    """At a state; `depth` is the hood's `guide_depth`, which no state changes."""
    springs, forces, c = hood.model.springs, hood.group_forces(state), state.configuration
    laid = (hood.model.reference, hood.rest.position, hood.rest.rotation)
    placed = (c.x, c.position, c.rotation)
    return FeView(
        points=c.x,
        reference=hood.model.reference,
        spring_force={
            name: float(np.linalg.norm(forces[name]))
            for name in hood.groups
            if not name.startswith(REPAIRS)
        },
        repair_force=repair_forces(hood, state),
        spring_tension=spring_state(springs, c.x, c.position, c.rotation).force,
        spring_set=tuple(hood.groups[i] for i in springs.group),
        spring_node=springs.node,
        penetration=max(0.0, -float(hood.gap(state).min())),
        compression=hood.compression(state),
        guide_depth=depth,
        friction=friction_audit(hood, state),
        unstable_modes=state.solution.factor.negative,
        glide=glide(lines.places, laid, placed),
        tendon_shift=tendon_shift(lines.mcp, laid, placed),
        band_height=band_heights(lines.bands, c.x, c.position, c.rotation, lines.axis),
        ropes=rope_lines(hood, state),
        iterations=state.iterations,
        attempt=state.attempt,
    )


def friction_audit(hood: FeHood, state: State) -> dict[str, float]:
    """How far the hood's friction exceeds Coulomb's cone, over the largest limit, and the work that
    it has done in place of taking it, over its work without signs; empty without friction."""
    c, contacts = state.configuration, state.solution.model.contacts
    rubbing = [k for k in contacts if k.grip is not None]
    if not rubbing:
        return {}
    defects = [coulomb_defects(k, c.x, c.position, c.rotation) for k in rubbing]
    excess, limit = (max(getattr(d, name) for d in defects) for name in ("excess", "limit"))
    made, work = (sum(getattr(d, name) for d in defects) for name in ("made", "work"))
    return {
        "friction_beyond_cone": excess / limit if limit > 0 else excess,
        "friction_work_made": made / work if work > 0 else made,
    }


def rope_lines(hood: FeHood, state: State) -> dict[str, Array]:
    """Lines (3, 3) m by tendon that runs through an eyelet: the middle of its end, the eyelet, and
    a point MUSCLE beyond it."""
    ropes, c = hood.model.ropes, state.configuration
    if not ropes.node.size:
        return {}
    at = c.position[ropes.body] + ropes.arm(c.rotation)
    places = np.stack([c.x[ropes.node], at, at + MUSCLE * ropes.along(c.rotation)], axis=1)
    shares = zip(hood.tendons, ropes.share, strict=True)
    return {t: np.tensordot(share, places, 1) for t, share in shares if share.any()}


def repair_forces(hood: FeHood, state: State) -> dict[str, float]:
    """Return the tensions (N) of each suture and graft together, by its name."""
    model, c = hood.model, state.configuration
    each = (
        (model.springs.group, spring_state(model.springs, c.x, c.position, c.rotation).force),
        (model.links.group, node_spring_state(model.links, c.x).force),
    )
    total = np.sum([np.bincount(i, force, len(hood.groups)) for i, force in each], axis=0)
    return {name: float(total[i]) for i, name in enumerate(hood.groups) if name.startswith(REPAIRS)}


def spring_pulls(hood: FeHood, state: State) -> dict[str, tuple[Axial, Array]]:
    """By set, what its springs do along themselves, (k,), and the unit directions (k, 3) in which
    they stretch, in the world frame; those to bodies come first."""
    m, c = hood.model, state.configuration
    placed = (c.x, c.position, c.rotation)
    ends = (*spring_state(m.springs, *placed), spring_directions(m.springs, *placed))
    between = (*node_spring_state(m.links, c.x), node_spring_directions(m.links, c.x))
    out = {}
    for i, s in enumerate(hood.springs):
        on, off = m.springs.group == i, m.links.group == i
        both = zip(ends, between, strict=True)
        *axial, along = (np.concatenate([a[on], b[off]]) for a, b in both)
        out[s.name] = Axial(*axial), along
    return out


def repair_stretches(hood: FeHood, state: State) -> dict[str, float]:
    """How much longer than at rest each suture and graft is where it is most so, m."""
    pulls = spring_pulls(hood, state).items()
    return {name: float(p.stretch.max()) for name, (p, _) in pulls if name.startswith(REPAIRS)}


def slip_forces(hood: FeHood, state: State) -> dict[str, float]:
    """Forces (N) on the bone of the central slip (0 where nothing but the sheet holds it) and of
    the terminal one, with their sutures."""
    forces = hood.group_forces(state)
    every = {
        slip: forces.get(slip, np.zeros(3)) + forces.get(f"suture_{slip}", np.zeros(3))
        for slip in SLIPS
    }
    return {slip.removesuffix("_slip"): float(np.linalg.norm(f)) for slip, f in every.items()}


def stored_energy(state: State) -> float:
    """The energy (J) in sheet or cables, springs and contact."""
    energy: float = state.solution.evaluation.energy
    return energy


def guide_depth(hood: FeHood) -> float:
    """How deep (m) under the metacarpal's contact level the lines run on which the extensor
    tendons' ends slide, from where these were laid to the MCP; 0 where all stay above it.

    The bone would pinch the sheet against such a line, with a force that grows as the mesh gets
    finer.  (Intrinsic tendons, which run palmar of the axis, pass beside the head.)"""
    model = hood.model
    lift = hood.lift
    start = (model.reference[model.guides.node] - hood.rest.position[0]) @ hood.rest.rotation[0]
    dorsal = start[:, 2] > 0
    way = lines_to_joint(start[dorsal])
    nodes = model.guides.node[dorsal]
    deepest = 0.0
    own = np.zeros(len(lift)) if hood.sheet is None else heights(hood.sheet)
    for contact in model.contacts:
        if contact.body != 0:
            continue
        felt = own if contact.layer is None else own - lift
        felt = felt[contact.nodes] if contact.within is None else contact.within.mean(felt)
        level = float((contact.offset - felt).mean()) + own[nodes]
        depth = np.repeat(level, way.shape[1]) - contact.surface.distance(way.reshape(-1, 3)).value
        deepest = max(deepest, float(depth.max(initial=0.0)))
    return deepest


def tangent_seconds(hood: FeHood, state: State) -> tuple[float, float]:
    """The time (s) that one assembly and one factorisation take at a state."""
    start = perf_counter()
    e = hood.model.evaluate(state.configuration, state.solution.tension, tangent=True)
    assembled = perf_counter()
    assert e.data is not None  # the tangent was asked for
    factorise(hood.model, e.data)
    return assembled - start, perf_counter() - assembled
