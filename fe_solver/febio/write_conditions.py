"""The conditions of a Job as sections of a FEBio 4 file, with the sets that they name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.febio.bodies import AXES, Units
from fe_solver.job.curves import Drive, LoadCurve
from fe_solver.job.job import Job
from fe_solver.supports import SpringLaw, SpringSet

Lines = Iterator[str]

SAME_POINT = 1e-12
"""m: an anchor that near a vertex of its body is that vertex."""
SAME_LENGTH = 1e-12
"""m: a spring's rest length that near its initial one needs no table."""


def number(value: float) -> str:
    """A number as XML text."""
    return repr(float(value))


def row(values: Iterable[float]) -> str:
    """Numbers of one row as XML text."""
    return ",".join(repr(float(v)) for v in values)


def whole(values: Iterable[int]) -> str:
    """Whole numbers as XML text."""
    return ",".join(str(int(v)) for v in values)


@dataclass
class Conditions:
    """A job with its nodes at `points` (n, 3) m on the face that FEBio puts them on, and what a
    file of it has numbered and named so far: load curves, lines of sets, and nodes (with their
    body) that only springs end at, m."""

    job: Job
    points: Array
    units: Units
    curves: dict[LoadCurve, int] = field(default_factory=dict)
    sets: list[str] = field(default_factory=list)
    extra: list[tuple[int, Array]] = field(default_factory=list)

    def first_vertex(self, body: int) -> int:
        """The number of a body's first vertex; that of the first extra node for one too many."""
        counts = [len(b.vertices) for b in self.job.bodies[:body]]
        return int(self.job.sheet.node_ids.max()) + 1 + sum(counts)

    def lines(self) -> Lines:
        """All sections.  The springs go first: they make nodes that the boundary section ties."""
        discrete = list(self._discrete())
        yield from self._boundary()
        yield from self._rigid()
        yield from self._loads()
        yield from self._contact()
        yield from discrete

    def _lc(self, curve: LoadCurve | None) -> str:
        if curve is None:
            return ""
        return f' lc="{self.curves.setdefault(curve, len(self.curves) + 1)}"'

    def _value(self, drive: Drive, unit: float, tag: str = "value") -> str:
        return f"<{tag}{self._lc(drive.curve)}>{number(drive.value / unit)}</{tag}>"

    def _node_set(self, name: str, nodes: Ints) -> str:
        self.sets.append(
            f"<NodeSet name={quoteattr(name)}>{whole(self.job.sheet.node_ids[nodes])}</NodeSet>"
        )
        return quoteattr(name)

    def _surface(self, name: str, facets: Iterable[tuple[int, ...]]) -> None:
        self.sets.append(f"<Surface name={quoteattr(name)}>")
        for i, facet in enumerate(facets, 1):
            kind = "tri3" if len(facet) == 3 else "quad4"
            self.sets.append(f'<{kind} id="{i}">{whole(facet)}</{kind}>')
        self.sets.append("</Surface>")

    def _facets(self, quads: Ints, sign: Ints) -> Iterator[tuple[int, ...]]:
        for i, s in zip(quads, sign, strict=True):
            facet = tuple(self.job.sheet.node_ids[self.job.sheet.quads[i]].tolist())
            facet = facet[:3] if facet[2] == facet[3] else facet
            yield facet if s > 0 else facet[::-1]

    def _boundary(self) -> Lines:
        yield "<Boundary>"
        job = self.job
        for i, t in enumerate(job.ties):
            name = self._node_set(f"tied {i + 1}", t.nodes)
            clamp = "" if t.clamped else "<clamp_shells>0</clamp_shells>"
            body = escape(job.bodies[t.body].name)
            yield f'<bc name={name} node_set={name} type="rigid"><rb>{body}</rb>{clamp}</bc>'
        for i, h in enumerate(job.held):
            name = self._node_set(f"held {i + 1}", h.nodes)
            axis = AXES[h.component]
            if h.displacement == Drive():
                inner = f"<{axis}_dof>1</{axis}_dof>"
                yield f'<bc name={name} node_set={name} type="zero displacement">{inner}</bc>'
            else:
                inner = f"<dof>{axis}</dof>{self._value(h.displacement, self.units.length)}"
                yield (
                    f'<bc name={name} node_set={name} type="prescribed displacement">{inner}'
                    "<relative>0</relative></bc>"
                )
        for i, d in enumerate(job.held_directors):
            name = self._node_set(f"held directors {i + 1}", d.nodes)
            axis = AXES[d.component]
            inner = f"<s{axis}_dof>1</s{axis}_dof>"
            yield f'<bc name={name} node_set={name} type="zero shell displacement">{inner}</bc>'
        for index in sorted({b for b, _ in self.extra}):
            ids = [
                self.first_vertex(len(self.job.bodies)) + i
                for i, (b, _) in enumerate(self.extra)
                if b == index
            ]
            name = quoteattr(f"anchors {index + 1}")
            self.sets.append(f"<NodeSet name={name}>{whole(ids)}</NodeSet>")
            rb = escape(job.bodies[index].name)
            yield f'<bc name={name} node_set={name} type="rigid"><rb>{rb}</rb></bc>'
        yield "</Boundary>"

    def _rigid(self) -> Lines:
        yield "<Rigid>"
        for body in self.job.bodies:
            name = escape(body.name)
            fixed = ""
            moved = []
            for axis, u, drive in zip(
                "xyzuvw", "xyz" + "uvw", (*body.displacement, *body.rotation), strict=True
            ):
                still = drive == Drive()
                fixed += f"<R{axis}_dof>{int(still)}</R{axis}_dof>"
                if not still:
                    turns = u in "uvw"
                    kind = "rigid_rotation" if turns else "rigid_displacement"
                    value = self._value(drive, 1.0 if turns else self.units.length)
                    dof = f"R{u}" if turns else u
                    moved.append(
                        f'<rigid_bc type="{kind}"><rb>{name}</rb><dof>{dof}</dof>{value}</rigid_bc>'
                    )
            yield f'<rigid_bc type="rigid_fixed"><rb>{name}</rb>{fixed}</rigid_bc>'
            yield from moved
        yield "</Rigid>"

    def _loads(self) -> Lines:
        yield "<Loads>"
        for i, f in enumerate(self.job.forces):
            name = self._node_set(f"loaded {i + 1}", f.nodes)
            value = f"<value{self._lc(f.curve)}>{row(f.force / self.units.force)}</value>"
            yield f'<nodal_load name={name} node_set={name} type="nodal_force">{value}</nodal_load>'
        for i, p in enumerate(self.job.pressures):
            name = f"pressed {i + 1}"
            self._surface(name, self._facets(p.quads, p.sign))
            value = self._value(p.pressure, self.units.stress, "pressure")
            yield (
                f'<surface_load name={quoteattr(name)} surface={quoteattr(name)} type="pressure">'
                f"{value}<linear>{int(p.dead)}</linear></surface_load>"
            )
        yield "</Loads>"

    def _contact(self) -> Lines:
        yield "<Contact>"
        for i, c in enumerate(self.job.contacts):
            shell, rigid, pair = (f"{w} {i + 1}" for w in ("sliding", "slid on", "contact"))
            self._surface(shell, self._facets(c.quads, np.ones_like(c.quads)))
            first = self.first_vertex(c.body)
            self._surface(rigid, ((*(t + first).tolist(),) for t in c.triangles))
            self.sets.append(
                f"<SurfacePair name={quoteattr(pair)}><primary>{shell}</primary>"
                f"<secondary>{rigid}</secondary></SurfacePair>"
            )
            if len(np.unique(c.side)) > 1:
                raise InputError(f"contact {c.name!r}: FEBio's contact is on one face of the shell")
            unit = 1.0 if c.automatic else self.units.force / self.units.length**3
            inner = f"<penalty>{number(c.penalty / unit)}</penalty>"
            inner += f"<auto_penalty>{int(c.automatic)}</auto_penalty>"
            if c.friction:
                inner += f"<fric_coeff>{number(c.friction)}</fric_coeff>"
            if c.gap:
                inner += f"<offset>{number(c.gap / self.units.length)}</offset>"
            if (c.side < 0).any():
                inner += "<shell_bottom_primary>1</shell_bottom_primary>"
            yield (
                f"<contact name={quoteattr(c.name)} surface_pair={quoteattr(pair)} "
                f'type="sliding-elastic">{inner}</contact>'
            )
        yield "</Contact>"

    def _anchor(self, body: int, point: Array) -> int:
        """The number of the node that a spring ends at on a body."""
        own = self.job.bodies[body]
        if len(own.triangles):
            used = np.unique(own.triangles)
            gap = np.linalg.norm(own.vertices[used] - point, axis=1)
            if gap.min() <= SAME_POINT:
                return self.first_vertex(body) + int(used[gap.argmin()])
        place = own.origin + point
        for i, (b, x) in enumerate(self.extra):
            if b == body and np.linalg.norm(x - place) <= SAME_POINT:
                return self.first_vertex(len(self.job.bodies)) + i
        self.extra.append((body, place))
        return self.first_vertex(len(self.job.bodies)) + len(self.extra) - 1

    def _spring_sets(self) -> Iterator[tuple[str, str]]:
        """Name and law of each set that FEBio needs: springs rest at their initial length there, so
        that those of one slack make a set."""
        for s in self.job.springs:
            slack = s.length - self._initial(s)
            slack[np.abs(slack) < SAME_LENGTH] = 0.0
            levels = np.unique(slack)
            for i, level in enumerate(levels):
                own = np.flatnonzero(slack == level)
                name = s.name if len(levels) == 1 else f"{s.name} {i + 1}"
                self.sets.append(f"<DiscreteSet name={quoteattr(name)}>")
                for k in own:
                    far = int(s.other[k])
                    end = (
                        int(self.job.sheet.node_ids[far])
                        if s.body[k] < 0
                        else self._anchor(int(s.body[k]), s.anchor[k])
                    )
                    self.sets.append(f"<delem>{self.job.sheet.node_ids[s.nodes[k]]},{end}</delem>")
                self.sets.append("</DiscreteSet>")
                yield name, self._spring_law(s.law, float(level))

    def _initial(self, s: SpringSet) -> Array:
        """(k,) m between the ends as the file has them."""
        origins = np.array([b.origin for b in self.job.bodies] or [np.zeros(3)])
        far = np.where(
            (s.body < 0)[:, None], self.points[s.other], origins[np.maximum(s.body, 0)] + s.anchor
        )
        return np.asarray(np.linalg.norm(far - self.points[s.nodes], axis=1))

    def _spring_law(self, law: SpringLaw, slack: float) -> str:
        if law.toe or np.ndim(law.stiffness):
            raise InputError(
                "a set of springs with a toe, or of several stiffnesses, is not written in FEBio's "
                "format; give the toe as a table, and a set to each stiffness"
            )
        each = float(law.stiffness)
        if law.table is None and not slack:
            kind = "tension-only linear spring" if law.tension_only else "linear spring"
            stiffness = each * self.units.length / self.units.force
            return f'type="{kind}"><E>{number(stiffness)}</E>'
        curve = law.table
        if curve is None:
            span = abs(slack)
            left = 0.0 if law.tension_only else -each * span
            points = [(slack - span, left), (slack, 0.0), (slack + span, each * span)]
            how = "<interpolate>LINEAR</interpolate><extend>EXTRAPOLATE</extend>"
        elif law.tension_only:
            raise InputError("FEBio has no tension-only spring with a table; make the table zero")
        else:
            points = [(x + slack, f) for x, f in zip(curve.times, curve.values, strict=True)]
            how = f"<interpolate>{curve.interpolation}</interpolate>"
            how += f"<extend>{curve.extension}</extend>"
        scale = (self.units.length, self.units.force)
        rows = "".join(f"<pt>{row((x / scale[0], f / scale[1]))}</pt>" for x, f in points)
        return f'type="nonlinear spring"><force type="point">{how}<points>{rows}</points></force>'

    def _discrete(self) -> Lines:
        yield "<Discrete>"
        springs = list(self._spring_sets())
        for i, (name, law) in enumerate(springs, 1):
            yield f'<discrete_material id="{i}" name={quoteattr(name)} {law}</discrete_material>'
        for i, (name, _) in enumerate(springs, 1):
            yield f'<discrete dmat="{i}" discrete_set={quoteattr(name)}/>'
        yield "</Discrete>"
