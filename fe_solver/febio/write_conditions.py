"""The conditions of a Job as sections of a FEBio 4 file, with the sets that they name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.elements.mitc9 import IN_TURN
from fe_solver.febio.bodies import AXES, DOFS
from fe_solver.febio.mesh import Units
from fe_solver.febio.middle import constraint_tag
from fe_solver.febio.xml import Element, tag
from fe_solver.forces.ramp import ramp
from fe_solver.job.curves import Curve, Drive, Extension, LoadCurve, ProductCurve, SumCurve
from fe_solver.job.job import Job
from fe_solver.supports import SpringLaw, SpringSet

TOE_POINTS = 21
"""Points of the table that a spring's toe becomes."""
TURNED = [3, 2, 1, 0, 7, 5, 6, 4, 8]
"""Our nine nodes as FEBio's of a facet that is wound the other way."""
SAME_POINT = 1e-12
"""m: an anchor that near a vertex of its body is that vertex."""
SAME_LENGTH = 1e-12
"""m: a spring's rest length that near its initial one needs no table."""


IN_MIDDLE = -1


@dataclass
class Conditions:
    """A job, and what a file of it has numbered and named so far."""

    job: Job
    points: Array
    """(n, 3) m, the nodes on the face that FEBio puts them on."""
    units: Units
    curves: dict[Curve, int] = field(default_factory=dict)
    """Number of each load curve."""
    sets: list[Element] = field(default_factory=list)
    extra: list[tuple[int, Array]] = field(default_factory=list)
    """Nodes that only springs end at: the body, IN_MIDDLE of none, and the place, m."""
    middle: Array | None = None
    """(n, 3) m of the middle of the sheet, where what holds and loads it acts; None: on the
    nodes."""
    in_middle: dict[int, int] = field(default_factory=dict)
    """By node of the sheet, the number of that in the middle over it."""

    def first_vertex(self, body: int) -> int:
        """The number of a body's first vertex; that of the first extra node for one too many."""
        counts = [len(b.vertices) for b in self.job.bodies[:body]]
        return int(self.job.sheet.node_ids.max()) + 1 + sum(counts)

    def sections(self) -> list[Element]:
        """All sections.  The springs go first: they make nodes that the boundary section ties."""
        discrete = tag("Discrete", *self._discrete())
        return [
            tag("Boundary", *self._boundary()),
            tag("Rigid", *self._rigid()),
            tag("Loads", *self._loads()),
            tag("Contact", *self._contact()),
            discrete,
        ]

    def scaled(self, kind: str, value: object, curve: Curve | None) -> Element:
        """A value that a load curve, where there is one, scales."""
        if curve is None:
            return tag(kind, value)
        return tag(kind, value, lc=self.curves.setdefault(curve, len(self.curves) + 1))

    def _value(self, drive: Drive, unit: float, kind: str = "value") -> Element:
        return self.scaled(kind, drive.value / unit, drive.curve)

    def _surface(self, name: str, facets: Iterable[tuple[int, ...]]) -> None:
        rows = [
            tag({3: "tri3", 4: "quad4", 9: "quad9"}[len(facet)], facet, id=i)
            for i, facet in enumerate(facets, 1)
        ]
        self.sets.append(tag("Surface", *rows, name=name))

    def _facets(self, quads: Ints, sign: Ints) -> Iterator[tuple[int, ...]]:
        for i, s in zip(quads, sign, strict=True):
            facet = tuple(self.job.sheet.node_ids[self.job.sheet.quads[i]].tolist())
            if len(facet) == 9:
                yield tuple(facet[j] for j in (IN_TURN if s > 0 else TURNED))
            else:
                facet = facet[:3] if facet[2] == facet[3] else facet
                yield facet if s > 0 else facet[::-1]

    def _on_nodes(
        self, kind: str, name: str, ids: Iterable[int], how: str, *content: Element
    ) -> Element:
        """A condition `how` on nodes (their numbers), with the set of them."""
        self.sets.append(tag("NodeSet", ids, name=name))
        return tag(kind, *content, name=name, node_set=name, type=how)

    def _boundary(self) -> Iterator[Element]:
        job, ids = self.job, self.job.sheet.node_ids
        for i, t in enumerate(job.ties, 1):
            inner = [tag("rb", job.bodies[t.body].name)]
            inner += [] if t.clamped else [tag("clamp_shells", 0)]
            yield self._on_nodes("bc", f"tied {i}", ids[t.nodes], "rigid", *inner)
        for i, h in enumerate(job.held, 1):
            name, axis = f"held {i}", AXES[h.component]
            if self.middle is not None:
                if h.displacement != Drive():
                    raise InputError(f"{name}: the middle of a sheet is written as held alone")
                yield from (constraint_tag(n, axis, 0.0, -1.0, n) for n in ids[h.nodes].tolist())
                continue
            if h.displacement == Drive():
                how, inner = "zero displacement", [tag(f"{axis}_dof", 1)]
            else:
                how, value = (
                    "prescribed displacement",
                    self._value(h.displacement, self.units.length),
                )
                inner = [tag("dof", axis), value, tag("relative", 0)]
            yield self._on_nodes("bc", name, ids[h.nodes], how, *inner)
        for i, d in enumerate(job.held_directors, 1):
            name, dof = f"held directors {i}", tag(f"s{AXES[d.component]}_dof", 1)
            yield self._on_nodes("bc", name, ids[d.nodes], "zero shell displacement", dof)
        first = self.first_vertex(len(job.bodies))
        for node, number in self.in_middle.items():
            of = int(ids[node])
            yield from (constraint_tag(number, axis, 0.5, 0.5, of) for axis in AXES)
        for index in sorted({b for b, _ in self.extra} - {IN_MIDDLE}):
            anchors = [first + i for i, (b, _) in enumerate(self.extra) if b == index]
            rb = tag("rb", job.bodies[index].name)
            yield self._on_nodes("bc", f"anchors {index + 1}", anchors, "rigid", rb)

    def _rigid(self) -> Iterator[Element]:
        for body in self.job.bodies:
            drives = dict(zip(DOFS, (*body.displacement, *body.rotation), strict=True))
            fixed = [tag(d.fixed, drive == Drive()) for d, drive in drives.items()]
            yield tag("rigid_bc", tag("rb", body.name), *fixed, type="rigid_fixed")
            for d, drive in drives.items():
                if drive != Drive():
                    value = self._value(drive, d.unit(self.units))
                    inner = (tag("rb", body.name), tag("dof", d.name), value)
                    yield tag("rigid_bc", *inner, type=d.kind)

    def _loads(self) -> Iterator[Element]:
        for i, f in enumerate(self.job.forces, 1):
            name, ids = f"loaded {i}", self.job.sheet.node_ids[f.nodes]
            share = 1.0 if self.middle is None else 0.5
            value, back = (
                self.scaled("value", share * f.force / self.units.force, f.curve) for _ in range(2)
            )
            yield self._on_nodes("nodal_load", name, ids, "nodal_force", value)
            if self.middle is not None:
                more = {"name": f"{name}, back", "node_set": name, "type": "nodal_force"}
                yield tag("nodal_load", back, tag("shell_bottom", 1), **more)
        for i, p in enumerate(self.job.pressures, 1):
            name = f"pressed {i}"
            self._surface(name, self._facets(p.quads, p.sign))
            inner = (
                self._value(p.pressure, self.units.stress, "pressure"),
                tag("linear", p.dead),
            )
            yield tag("surface_load", *inner, name=name, surface=name, type="pressure")

    def _contact(self) -> Iterator[Element]:
        surfaces: dict[tuple[int, bytes], str] = {}
        for i, c in enumerate(self.job.contacts, 1):
            shell, pair = f"sliding {i}", f"contact {i}"
            self._surface(shell, self._facets(c.quads, np.ones_like(c.quads)))
            first, key = self.first_vertex(c.body), (c.body, c.triangles.tobytes())
            rigid = surfaces.setdefault(key, f"slid on {i}")
            if rigid == f"slid on {i}":
                self._surface(rigid, ((*(t + first).tolist(),) for t in c.triangles))
            sides = (tag("primary", shell), tag("secondary", rigid))
            self.sets.append(tag("SurfacePair", *sides, name=pair))
            if len(np.unique(c.side)) > 1:
                raise InputError(f"contact {c.name!r}: FEBio's contact is on one face of the shell")
            unit = 1.0 if c.automatic else self.units.force / self.units.length**3
            inner = {
                "penalty": c.penalty / unit,
                "auto_penalty": c.automatic,
                "laugon": c.augmented,
                "fric_coeff": c.friction,
                "offset": c.gap / self.units.length,
                "shell_bottom_primary": bool((c.side < 0).any()),
            }
            tags = [tag(k, v) for k, v in inner.items() if v or k.endswith("penalty")]
            yield tag("contact", *tags, name=c.name, surface_pair=pair, type="sliding-elastic")

    def _anchor(self, body: int, point: Array) -> int:
        """The number of the node that a spring ends at on a body."""
        solid = self.job.bodies[body]
        if len(solid.triangles):
            used = np.unique(solid.triangles)
            gap = np.linalg.norm(solid.vertices[used] - point, axis=1)
            if gap.min() <= SAME_POINT:
                return self.first_vertex(body) + int(used[gap.argmin()])
        place = solid.origin + point
        for i, (b, x) in enumerate(self.extra):
            if b == body and np.linalg.norm(x - place) <= SAME_POINT:
                return self.first_vertex(len(self.job.bodies)) + i
        self.extra.append((body, place))
        return self.first_vertex(len(self.job.bodies)) + len(self.extra) - 1

    def _spring_sets(self) -> Iterator[tuple[str, SpringLaw, float]]:
        """Name, law and slack (m) of each set that FEBio needs: springs rest at their initial
        length there, so that those of one stiffness and slack make a set."""
        for s in self.job.springs:
            slack = s.length - self._initial(s)
            slack[np.abs(slack) < SAME_LENGTH] = 0.0
            each = np.column_stack([np.broadcast_to(s.law.stiffness, slack.shape), slack])
            kinds, kind = np.unique(each, axis=0, return_inverse=True)
            for i, (stiffness, level) in enumerate(kinds.tolist()):
                name = s.name if len(kinds) == 1 else f"{s.name} {i + 1}"
                rows = [self._ends(s, int(k)) for k in np.flatnonzero(kind.reshape(-1) == i)]
                self.sets.append(tag("DiscreteSet", *rows, name=name))
                yield name, replace(s.law, stiffness=stiffness), level

    def _ends(self, s: SpringSet, k: int) -> Element:
        """The nodes that a set's spring k joins."""
        own = s.body[k] < 0
        end = self._end(s.other[k]) if own else self._anchor(int(s.body[k]), s.anchor[k])
        return tag("delem", (self._end(s.nodes[k]), end))

    def _end(self, node: int) -> int:
        """The number of the node at which a spring pulls the sheet over one of its nodes."""
        if self.middle is None:
            return int(self.job.sheet.node_ids[node])
        if node not in self.in_middle:
            self.in_middle[node] = self.first_vertex(len(self.job.bodies)) + len(self.extra)
            self.extra.append((IN_MIDDLE, self.middle[node]))
        return self.in_middle[node]

    def _initial(self, s: SpringSet) -> Array:
        """The distances (k,) m between the springs' ends as the file has them."""
        origins = np.array([b.origin for b in self.job.bodies] or [np.zeros(3)])
        far = np.where(
            (s.body < 0)[:, None], self.points[s.other], origins[np.maximum(s.body, 0)] + s.anchor
        )
        return np.asarray(np.linalg.norm(far - self.points[s.nodes], axis=1))

    def _spring_law(self, law: SpringLaw, slack: float) -> tuple[str, Element]:
        """The spring's type and what says its force."""
        stiffness = float(law.stiffness)
        if law.tension_only and law.toe:
            law = SpringLaw(stiffness, table=_toe_table(stiffness, law.toe))
        if law.table is None and not slack:
            kind = "tension-only linear spring" if law.tension_only else "linear spring"
            return kind, tag("E", stiffness * self.units.length / self.units.force)
        if law.table is None:
            span = abs(slack)
            left = 0.0 if law.tension_only else -stiffness * span
            times, values = (slack - span, slack, slack + span), (left, 0.0, stiffness * span)
            curve = LoadCurve(times, values, extension=Extension.EXTRAPOLATE)
        elif law.tension_only:
            raise InputError("FEBio has no tension-only spring with a table; make the table zero")
        else:
            curve = replace(law.table, times=tuple(x + slack for x in law.table.times))
        inner = curve_tags(curve, self.units.length, self.units.force)
        return "nonlinear spring", tag("force", *inner, type="point")

    def _discrete(self) -> Iterator[Element]:
        sets = list(self._spring_sets())
        for i, (name, law, slack) in enumerate(sets, 1):
            kind, force = self._spring_law(law, slack)
            yield tag("discrete_material", force, id=i, name=name, type=kind)
        for i, (name, _, _) in enumerate(sets, 1):
            yield tag("discrete", dmat=i, discrete_set=name)


def _toe_table(stiffness: float, toe: float) -> LoadCurve:
    """The force (N) by elongation (m) of a spring with a toe, straight beyond it: slack before."""
    stretch = toe * np.concatenate([[-2.0], np.linspace(-1.0, 1.0, TOE_POINTS), [2.0]])
    times, values = tuple(stretch.tolist()), tuple((stiffness * ramp(stretch, toe)[1]).tolist())
    return LoadCurve(times, values, extension=Extension.EXTRAPOLATE)


def controller_tag(curve: Curve, number: int) -> Element:
    """A curve as a load controller.  Raises InputError for a product, which FEBio cannot say."""
    match curve:
        case LoadCurve():
            return tag("load_controller", *curve_tags(curve), id=number, type="loadcurve")
        case ProductCurve() | SumCurve():
            raise InputError(
                "FEBio has no load curve that is a product or a sum of others, as of what ends "
                "with its step; give its points"
            )
    formula = tag("math", curve.text)
    if curve.interval is None:
        return tag("load_controller", formula, id=number, type="math")
    ends = (tag("left_extend", curve.before), tag("right_extend", curve.after))
    inner = (tag("interval", curve.interval), *ends, formula)
    return tag("load_controller", *inner, id=number, type="math-interval")


def curve_tags(c: LoadCurve, across: float = 1.0, along: float = 1.0) -> list[Element]:
    """A curve, its times over `across` and its values over `along`."""
    points = zip(c.times, c.values, strict=True)
    return [
        tag("interpolate", c.interpolation),
        tag("extend", c.extension),
        tag("points", *[tag("pt", (x / across, y / along)) for x, y in points]),
    ]
