"""The materials of a FEBio 4 file, and the directions of their fibres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Ints
from fe_solver.febio.laws import InSitu, fibre_in_axes, read_law
from fe_solver.febio.values import ElementData, Place
from fe_solver.febio.xml import FebTag
from fe_solver.materials.crossed_fibres import CrossedFibres
from fe_solver.materials.fibres import HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.linear import Law, Orthotropic, Real

RIGID = "rigid body"
DENSITY = 1.0
"""FEBio's, where a material says none."""
IN_PLANE = 0.9
"""Least cosine between the third material axis and the sheet's normal."""


@dataclass(frozen=True)
class Material:
    """A material of the file."""

    tag: FebTag
    name: str
    number: str
    rigid: bool
    """Whether it is a rigid body."""
    centre: Array | None
    """(3,) of a rigid one, in the file's units, where it is given."""


@dataclass(frozen=True)
class ShellMaterial:
    """What a part of the sheet is made of."""

    tag: FebTag
    law: Law
    holder: FebTag
    """The tag in which its (first) fibre is said."""
    in_situ: InSitu
    density: Real | None
    """In the file's units; None where the tags within say more than one."""


def shell_material(m: Material, stress: float, place: Place) -> ShellMaterial:
    """A material where it is, stresses in units of `stress` Pa.

    Raises InputError for a material or a parameter that is not known, or not allowed."""
    law, holder, stretch = read_law(m.tag, stress, place)
    inner = m.tag.one("elastic")
    given = [t.one("density") for t in (m.tag, *m.tag.all("solid"), *([inner] if inner else []))]
    told = [t for t in given if t is not None]
    density = place.value(told[0] if told else None, DENSITY)
    alone = not m.tag.all("solid") and len({t.text.strip() for t in told}) <= 1
    return ShellMaterial(m.tag, law, holder, stretch, density if alone else None)


def read_materials(section: FebTag) -> list[Material]:
    """The materials by name and number."""
    out: list[Material] = []
    for t in section.all("material"):
        number = t.attributes.get("id", str(len(out) + 1))
        name = t.attributes.get("name", f"material {number}").strip()
        if name in [m.name for m in out]:
            raise t.fault(f"two materials are called {name!r}")
        t.all("density")
        if t.attribute("type") == RIGID:
            out.append(Material(t, name, number, True, _centre(t)))
        else:
            out.append(Material(t, name, number, False, None))
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


def fibre_directions(
    m: ShellMaterial,
    corners: Array,
    ids: Ints,
    special: Mapping[str, Sequence[ElementData]],
    maps: Mapping[str, ElementData],
) -> Array:
    """Directions (k, 3) of axis 1 on elements with corners (k, 4, 3) and numbers (k,), not yet in
    their planes.

    `special` holds ElementData by type (`fiber`, `mat_axis`), `maps` all others by name.
    Raises InputError where they cannot be told."""
    axes = _axes(m, corners, ids, special["mat_axis"])
    if isinstance(m.law, TransIsoMooneyRivlin) and np.any(np.add(m.law.c3, m.law.c5) > 0):
        fibre = _fibre(m, corners, ids, special["fiber"], maps)
        return np.einsum("kij,kj->ki", axes, fibre)
    if isinstance(m.law, CrossedFibres):
        _check_axes_up(m, corners, axes)
        return np.einsum("kij,j->ki", axes, fibre_in_axes(m.holder))
    if isinstance(m.law, HolzapfelGasserOgden | Orthotropic):
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        cosine = np.abs(np.einsum("ki,ki->k", axes[:, :, 2], _unit(normal)))
        if cosine.min(initial=1.0) < IN_PLANE:
            raise m.tag.fault("the material axes 1 and 2 must lie in the sheet; give mat_axis")
        return axes[:, :, 0]
    m.tag.all("fiber")
    return corners[:, 1] - corners[:, 0]


def _check_axes_up(m: ShellMaterial, corners: Array, axes: Array) -> None:
    """Check that the third material axis is the elements' normal, about which one family is turned
    from the other.  Raises InputError where it is not."""
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


def _given_to(data: Sequence[ElementData], ids: Ints) -> ElementData | None:
    """The last that gives something to one of the elements (k,)."""
    given = [d for d in data if np.isin(ids, d.elements).any()]
    return given[-1] if given else None


def _axes(m: ShellMaterial, corners: Array, ids: Ints, given: Sequence[ElementData]) -> Array:
    k = len(corners)
    data, tag = _given_to(given, ids), m.tag.one("mat_axis")
    if data is not None:
        vectors = np.empty((k, 2, 3))
        for i, row in enumerate(data.tags_at(ids)):
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
    return tag.needed(name, "three numbers").numbers(3)


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


def _fibre(
    m: ShellMaterial,
    corners: Array,
    ids: Ints,
    given: Sequence[ElementData],
    maps: Mapping[str, ElementData],
) -> Array:
    """The fibre directions (k, 3) in the material axes."""
    k, tag = len(corners), m.holder.one("fiber")
    kind = "" if tag is None else tag.attributes.get("type", "vector")
    data = _given_to(given, ids)
    if tag is not None and kind == "map":
        data = maps.get(tag.text.strip())
        if data is None:
            raise tag.fault(f"there is no ElementData called {tag.text.strip()!r}")
    if data is not None:
        return data.all_at(ids, (3,))
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
