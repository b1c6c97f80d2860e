"""FEBio's materials as laws of the sheet, and the directions of their fibres.

Parameters as in FEBio's feature manual; stresses are scaled by `stress` Pa, the file's unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cosim.port import Array
from fe_solver.febio.mesh import rows_of
from fe_solver.febio.xml import FebTag
from fe_solver.materials.crossed_fibres import CrossedFibres
from fe_solver.materials.fibres import ExponentialFamily, HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Law, Orthotropic

RIGID = "rigid body"
IN_PLANE = 0.9
"""Least cosine between the third material axis and the sheet's normal."""
MATRICES, EXPONENTIAL = ("Mooney-Rivlin", "trans iso Mooney-Rivlin"), "uncoupled fiber-exp-linear"
"""What may be the matrix of a mixture, and its fibres."""
OFF_PLANE = 1e-9
"""Third component of a mixture's fibre that is rounding."""
NO_FIBRES = {"c3": 0.0, "c4": 1.0, "c5": 0.0, "lam_max": 2.0}


@dataclass(frozen=True)
class Material:
    """A material of the file; a rigid one has no law, and a centre in the file's units where it is
    given.  `holder` is the tag in which its (first) fibre is said."""

    tag: FebTag
    name: str
    number: str
    law: Law | None
    centre: Array | None
    holder: FebTag
    in_situ_stretch: float = 1.0

    @property
    def rigid(self) -> bool:
        """Whether it is a rigid body."""
        return self.law is None


def read_materials(section: FebTag, stress: float) -> list[Material]:
    """Raises InputError for a material or a parameter that is not known, or not allowed."""
    out: list[Material] = []
    for t in section.all("material"):
        number = t.attributes.get("id", str(len(out) + 1))
        name = t.attributes.get("name", f"material {number}").strip()
        if name in [m.name for m in out]:
            raise t.fault(f"two materials are called {name!r}")
        t.all("density")
        if t.attribute("type") == RIGID:
            out.append(Material(t, name, number, None, _centre(t), t))
        else:
            law, holder, stretch = _deformable(t, stress)
            out.append(Material(t, name, number, law, None, holder, stretch))
    return out


def find_material(tag: FebTag, materials: list[Material], name: str) -> Material:
    """By name or number.  Raises InputError where there is none."""
    for m in materials:
        if name in (m.name, m.number):
            return m
    known = ", ".join(repr(m.name) for m in materials) or "none"
    raise tag.fault(f"there is no material {name!r}; the file has {known}")


def _centre(t: FebTag) -> Array | None:
    for ignored in ("E", "v", "override_com"):
        t.all(ignored)
    centre = t.one("center_of_mass")
    return None if centre is None else np.array(centre.numbers(3))


def _require_values(t: FebTag, *names: str) -> list[float]:
    missing = [n for n in names if t.one(n) is None]
    if missing:
        raise t.fault(f"the parameter <{missing[0]}> is missing")
    return [t.value(n, 0.0) for n in names]


def _deformable(t: FebTag, stress: float) -> tuple[Law, FebTag, float]:
    """The law, the tag that says its fibre, and the fibres' stretch in situ."""
    kind = t.attribute("type")
    if kind == "uncoupled solid mixture":
        return *_mixture(t, stress), 1.0
    if kind in ("prestrain elastic", "uncoupled prestrain elastic"):
        return _read_prestrain(t, stress)
    return _law(t, stress), t, 1.0


def _read_prestrain(t: FebTag, stress: float) -> tuple[Law, FebTag, float]:
    """A law whose fibres are stretched in situ."""
    inner, made = t.one("elastic"), t.one("prestrain")
    if inner is None or made is None:
        raise t.fault("expected <elastic> and <prestrain>")
    if inner.attribute("type") != "trans iso Mooney-Rivlin":
        raise inner.fault("prestrain is read of trans iso Mooney-Rivlin alone")
    if made.attribute("type") != "in-situ stretch":
        raise made.fault("prestrain is read as an in-situ stretch alone")
    if not made.value("isochoric", 1.0):
        raise made.fault("an in-situ stretch that changes the volume is not read; set isochoric 1")
    stretch = _require_values(made, "stretch")[0]
    if not (np.isfinite(stretch) and stretch > 0):
        raise made.fault(f"the stretch must be positive, got {stretch:g}")
    return _mooney_rivlin(inner, stress, False, t), inner, stretch


def _mixture(t: FebTag, stress: float) -> tuple[Law, FebTag]:
    """Matrix and one or two fibre families: a Mooney-Rivlin law with or without a fibre, and
    `uncoupled fiber-exp-linear` fibres."""
    solids = t.all("solid")
    kinds = [s.attribute("type") for s in solids]
    matrices = [s for s, k in zip(solids, kinds, strict=True) if k in MATRICES]
    fibres = [s for s, k in zip(solids, kinds, strict=True) if k == EXPONENTIAL]
    families = len(fibres) + sum(k == MATRICES[1] for k in kinds)
    if len(matrices) != 1 or len(matrices) + len(fibres) != len(solids) or families not in (1, 2):
        raise t.fault(
            f"a mixture is read of one {MATRICES[0]} or {MATRICES[1]} and {EXPONENTIAL} fibres, of "
            f"one or two families in all; got {', '.join(kinds) or 'none'}"
        )
    plain = matrices[0].attribute("type") == MATRICES[0]
    law = _mooney_rivlin(matrices[0], stress, plain, t)
    holder = fibres[0] if plain else matrices[0]
    if plain:
        with fibres[0].naming_place():
            law = replace(law, **vars(_family(fibres[0], stress)))
    if families == 1:
        return law, holder
    with t.naming_place():
        return CrossedFibres(law, _family(fibres[-1], stress), _turn(holder, fibres[-1])), holder


def _family(t: FebTag, stress: float) -> ExponentialFamily:
    c3, c4, c5, lam_max = _require_values(t, "c3", "c4", "c5", "lambda")
    with t.naming_place():
        return ExponentialFamily(c3 * stress, c4, c5 * stress, lam_max)


def _turn(first: FebTag, second: FebTag) -> float:
    """rad, from one solid's fibre to another's, counter-clockwise about the third material axis."""
    (a, b, c), (x, y, z) = (_in_axes(t) for t in (first, second))
    if abs(c) + abs(z) > OFF_PLANE:
        raise second.fault("the fibres of a mixture must lie in the sheet: x, y, 0")
    return float(np.arctan2(a * y - b * x, a * x + b * y))


def _in_axes(t: FebTag) -> list[float]:
    """A solid's fibre in the material axes."""
    tag = t.one("fiber")
    if tag is None:
        return [1.0, 0.0, 0.0]
    if tag.attributes.get("type", "vector") != "vector":
        raise tag.fault("in a mixture of two fibre families a fibre is read as a vector alone")
    return (tag.one("vector") or tag).numbers(3)


def _law(t: FebTag, stress: float) -> Law:
    kind = t.attribute("type")
    if kind == "isotropic elastic":
        E, v = _require_values(t, "E", "v")
        with t.naming_place():
            return Isotropic(E * stress, v)
    if kind == "neo-Hookean":
        E, v = _require_values(t, "E", "v")
        with t.naming_place():
            return NeoHookean(E * stress, v)
    if kind in ("trans iso Mooney-Rivlin", "Mooney-Rivlin"):
        return _mooney_rivlin(t, stress, kind == "Mooney-Rivlin")
    if kind == "Holzapfel-Gasser-Ogden":
        _pressure_model(t, "3", "Abaqus (GOH)")
        c, k1, k2, kappa, gamma, k = _require_values(t, "c", "k1", "k2", "kappa", "gamma", "k")
        gamma = float(np.radians(gamma))
        with t.naming_place():
            return HolzapfelGasserOgden(c * stress, k1 * stress, k2, kappa, gamma, k * stress)
    if kind == "orthotropic elastic":
        E1, E2, v12, *G = _require_values(t, "E1", "E2", "v12", "G12", "G31", "G23")
        E3, v23, v31 = t.value("E3", E2) * stress, t.value("v23", 0.0), t.value("v31", 0.0)
        G12, G13, G23 = (g * stress for g in G)
        with t.naming_place():
            return Orthotropic(E1 * stress, E2 * stress, v12, G12, G13, G23, E3, v23, v31)
    raise t.fault(
        f"the material {kind!r} is not known; known: isotropic elastic, neo-Hookean, "
        "Mooney-Rivlin, trans iso Mooney-Rivlin, Holzapfel-Gasser-Ogden, orthotropic elastic, "
        "uncoupled solid mixture, uncoupled prestrain elastic, rigid body"
    )


def _mooney_rivlin(
    t: FebTag, stress: float, plain: bool, volume: FebTag | None = None
) -> TransIsoMooneyRivlin:
    """The law; its bulk modulus is said in the tag `volume`, of a material that wraps it."""
    _pressure_model(volume or t, "0", "default")
    (c1, c2), (k,) = _require_values(t, "c1", "c2"), _require_values(volume or t, "k")
    names = tuple(NO_FIBRES)
    c3, c4, c5, lam = NO_FIBRES.values() if plain else _require_values(t, *names)
    fibre = (c3 * stress, c4, c5 * stress, lam)
    with t.naming_place():
        return TransIsoMooneyRivlin(c1 * stress, c2 * stress, *fibre, k * stress)


def _pressure_model(t: FebTag, *allowed: str) -> None:
    child = t.one("pressure_model")
    if child is not None and child.text.strip() not in allowed:
        raise child.fault(f"only the material's own pressure model ({allowed[1]!r}) is read")


def fibre_directions(
    m: Material, corners: Array, given: dict[str, FebTag], maps: dict[str, FebTag]
) -> Array:
    """Directions (k, 3) of axis 1 on elements with corners (k, 4, 3), not yet in their planes.

    `given` holds the part's ElementData by type (`fiber`, `mat_axis`), `maps` all others by name.
    Raises InputError where they cannot be told."""
    axes = _axes(m, corners, given)
    if isinstance(m.law, TransIsoMooneyRivlin) and m.law.c3 + m.law.c5 > 0:
        return np.einsum("kij,kj->ki", axes, _fibre(m, corners, given, maps))
    if isinstance(m.law, CrossedFibres):
        _check_axes_up(m, corners, axes)
        return np.einsum("kij,j->ki", axes, _in_axes(m.holder))
    if isinstance(m.law, HolzapfelGasserOgden | Orthotropic):
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        cosine = np.abs(np.einsum("ki,ki->k", axes[:, :, 2], _unit(normal)))
        if cosine.min(initial=1.0) < IN_PLANE:
            raise m.tag.fault("the material axes 1 and 2 must lie in the sheet; give mat_axis")
        return axes[:, :, 0]
    m.tag.all("fiber")
    return corners[:, 1] - corners[:, 0]


def _check_axes_up(m: Material, corners: Array, axes: Array) -> None:
    """Raises InputError where the third material axis is not the elements' normal, about which one
    family is turned from the other."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    if np.einsum("ki,ki->k", axes[:, :, 2], _unit(normal)).min(initial=1.0) < IN_PLANE:
        raise m.tag.fault(
            "the third material axis of two fibre families must be the shell's normal; give "
            "mat_axis"
        )


def _unit(v: Array) -> Array:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)


def _frame(a: Array, d: Array) -> Array:
    """Columns e1 along a, e3 across a and d, e2 across them (k, 3, 3)."""
    e3 = np.cross(a, d)
    return np.stack([_unit(a), _unit(np.cross(e3, a)), _unit(e3)], axis=-1)


def _axes(m: Material, corners: Array, given: dict[str, FebTag]) -> Array:
    k = len(corners)
    data, tag = given.get("mat_axis"), m.tag.one("mat_axis")
    if data is not None:
        rows = [c for c in data.children if c.name in ("e", "elem")]
        if len(rows) != k:
            raise data.fault(f"expected axes of {k} elements, got {len(rows)}")
        vectors = np.empty((k, 2, 3))
        for i, row in enumerate(rows):
            row.used = True
            vectors[i] = vector_in(row, "a"), vector_in(row, "d")
        return _frame(vectors[:, 0], vectors[:, 1])
    if tag is None:
        return np.tile(np.eye(3), (k, 1, 1))
    kind = tag.attributes.get("type", "local")
    if kind == "vector":
        a, d = np.array(vector_in(tag, "a")), np.array(vector_in(tag, "d"))
        return np.tile(_frame(a, d), (k, 1, 1))
    if kind == "local":
        i, j, l = _local(tag, 3, (1, 2, 4))  # noqa: E741
        return _frame(corners[:, j] - corners[:, i], corners[:, l] - corners[:, i])
    raise tag.fault(f"mat_axis of type {kind!r} is not read; known: vector, local")


def vector_in(tag: FebTag, name: str) -> list[float]:
    """The three numbers of the child of that name.  Raises InputError where there are none."""
    child = tag.one(name)
    if child is None:
        raise tag.fault(f"<{name}> is missing: three numbers")
    return child.numbers(3)


def _local(tag: FebTag, count: int, default: tuple[int, ...]) -> list[int]:
    """Positions within an element, counted from 0."""
    child = tag.one("local") or tag
    if not child.text.strip():
        return [i - 1 for i in default]
    values = child.numbers(count)
    if all(v == 0 for v in values):
        return [i - 1 for i in default]
    if any(v not in (1, 2, 3, 4) for v in values):
        raise child.fault(f"expected {count} of the element's nodes 1 to 4")
    return [int(v) - 1 for v in values]


def _fibre(m: Material, corners: Array, given: dict[str, FebTag], maps: dict[str, FebTag]) -> Array:
    """(k, 3) in the material axes."""
    k, tag = len(corners), m.holder.one("fiber")
    kind = "" if tag is None else tag.attributes.get("type", "vector")
    data = given.get("fiber")
    if tag is not None and kind == "map":
        data = maps.get(tag.text.strip())
        if data is None:
            raise tag.fault(f"there is no ElementData called {tag.text.strip()!r}")
        data.used = True
    if data is not None:
        _, _, values = rows_of(data, 3)
        if len(values) != k:
            raise data.fault(f"expected fibres of {k} elements, got {len(values)}")
        return values
    if tag is None or kind == "user":
        raise (tag or m.tag).fault("no fibre directions: give <fiber> or ElementData of type fiber")
    if kind == "vector":
        child = tag.one("vector") or tag
        return np.tile(child.numbers(3), (k, 1))
    if kind == "local":
        i, j = _local(tag, 2, (1, 2))
        return corners[:, j] - corners[:, i]
    if kind == "angles":
        theta, phi = np.radians([tag.value("theta", 0.0), tag.value("phi", 90.0)])
        along = [np.cos(theta) * np.sin(phi), np.sin(theta) * np.sin(phi), np.cos(phi)]
        return np.tile(along, (k, 1))
    raise tag.fault(
        f"fibres of type {kind!r} are not read; known: vector, local, angles, user, map"
    )
