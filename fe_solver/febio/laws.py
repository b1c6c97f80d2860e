"""FEBio's materials and our laws of the sheet, one table for both directions.

Parameters as in FEBio's feature manual; stresses are in units of `stress` Pa, the file's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cosim.errors import InputError
from fe_solver.febio.values import Values
from fe_solver.febio.xml import Element, FebTag, tag
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import ExponentialFamily, HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Law, Orthotropic, Real

MATRICES, EXPONENTIAL = ("Mooney-Rivlin", "trans iso Mooney-Rivlin"), "uncoupled fiber-exp-linear"
"""What may be the matrix of a mixture, and its fibres."""
MIXTURE, PRESTRAIN = "uncoupled solid mixture", "uncoupled prestrain elastic"
OFF_PLANE = 1e-9
"""Third component of a mixture's fibre that is rounding."""
NO_FIBRES = {"c3": 0.0, "c4": 1.0, "c5": 0.0, "lam_max": 2.0}


class Parameter(NamedTuple):
    """A parameter of a material, in the file and in our law."""

    tag: str
    """Its name in the file."""
    field: str
    """Its name in our law."""
    unit: str = "1"
    """The unit in the file: "stress", "degree" (rad in ours) or "1"."""
    default: float | None = None
    """What it is where the file does not say it."""
    like: str | None = None
    """The tag whose value it has where the file does not say it."""

    def factor(self, stress: float) -> float:
        """Our value over the file's."""
        return {"stress": stress, "1": 1.0, "degree": np.pi / 180}[self.unit]


@dataclass(frozen=True)
class FebLaw:
    """A material of FEBio's and the law that it is; `make` takes the law's fields."""

    kind: str
    make: Callable[..., Any]
    parameters: tuple[Parameter, ...]
    pressure_model: tuple[str, ...] = ()
    """Number and name of the material's own pressure model, where it has a choice."""


def _stresses(*names: str) -> tuple[Parameter, ...]:
    return tuple(Parameter(name, name, "stress") for name in names)


ELASTIC = (*_stresses("E"), Parameter("v", "nu"))
MATRIX = _stresses("c1", "c2", "k")
FIBRES = (*_stresses("c3", "c5"), Parameter("c4", "c4"))
DEFAULT, ABAQUS = ("0", "default"), ("3", "Abaqus (GOH)")
LAWS = (
    FebLaw("isotropic elastic", Isotropic, ELASTIC),
    FebLaw("neo-Hookean", NeoHookean, ELASTIC),
    FebLaw(
        "trans iso Mooney-Rivlin",
        TransIsoMooneyRivlin,
        (*MATRIX, *FIBRES, Parameter("lam_max", "lam_max")),
        DEFAULT,
    ),
    FebLaw("Mooney-Rivlin", partial(TransIsoMooneyRivlin, **NO_FIBRES), MATRIX, DEFAULT),
    FebLaw(
        "Holzapfel-Gasser-Ogden",
        HolzapfelGasserOgden,
        (
            *_stresses("c", "k1", "k"),
            Parameter("k2", "k2"),
            Parameter("kappa", "kappa"),
            Parameter("gamma", "gamma", "degree"),
        ),
        ABAQUS,
    ),
    FebLaw(
        "orthotropic elastic",
        Orthotropic,
        (
            *_stresses("E1", "E2"),
            Parameter("E3", "E3", "stress", like="E2"),
            Parameter("v12", "nu12"),
            Parameter("v23", "nu23", default=0.0),
            Parameter("v31", "nu31", default=0.0),
            *_stresses("G12", "G23"),
            Parameter("G31", "G13", "stress"),
        ),
    ),
    FebLaw(EXPONENTIAL, ExponentialFamily, (*FIBRES, Parameter("lambda", "lam_max"))),
)
BY_KIND = {law.kind: law for law in LAWS}
PLAIN = [law.kind for law in LAWS if law.kind != EXPONENTIAL]
"""Materials that stand alone."""


def needs_fibre(law: Law) -> bool:
    """Whether the law's answer depends on the fibre direction."""
    fibrous = TransIsoMooneyRivlin | HolzapfelGasserOgden | Orthotropic
    return isinstance(law, fibrous | CrossedFibres | CrossedLinear)


class InSitu(NamedTuple):
    """What fibres are stretched by in the mesh as it stands."""

    stretch: float = 1.0
    isochoric: bool = True
    """Whether the volume is kept; else it is a stretch along the fibres alone."""


def read_law(t: FebTag, stress: float, values: Values) -> tuple[Law, FebTag, InSitu]:
    """The law of a material, the tag that says its fibre, and the fibres' stretch in situ; `values`
    reads its parameters.

    Raises InputError for a material or a parameter that is not known, or not allowed."""
    kind = t.attribute("type")
    if kind == MIXTURE:
        return *_mixture(t, stress, values), InSitu()
    if kind in (PRESTRAIN, "prestrain elastic"):
        return _read_prestrain(t, stress, values)
    if kind not in PLAIN:
        raise t.fault(
            f"the material {kind!r} is not known; known: {', '.join(PLAIN)}, {MIXTURE}, "
            f"{PRESTRAIN}, rigid body"
        )
    return _read(t, stress, values), t, InSitu()


def _read(t: FebTag, stress: float, values: Values, volume: FebTag | None = None) -> Any:
    """The law of one tag; its bulk modulus is said in the tag `volume`, of a material that wraps
    it."""
    law = BY_KIND[t.attribute("type")]
    model = (volume or t).one("pressure_model") if law.pressure_model else None
    if model is not None and model.text.strip() not in law.pressure_model:
        raise model.fault(
            f"only the material's own pressure model ({law.pressure_model[1]!r}) is read"
        )
    holders = {p: (volume or t) if p.tag == "k" else t for p in law.parameters}
    for p, holder in holders.items():
        if p.default is None and p.like is None and holder.one(p.tag) is None:
            raise holder.fault(f"the parameter <{p.tag}> is missing")
    read: dict[str, Real] = {}
    for p, holder in holders.items():
        found = holder.one(p.tag)
        like = read[p.like] if p.like else p.default or 0.0
        read[p.tag] = like if found is None else values.value(found, 0.0)
    with t.naming_place():
        return law.make(**{p.field: read[p.tag] * p.factor(stress) for p in law.parameters})


def _read_prestrain(t: FebTag, stress: float, values: Values) -> tuple[Law, FebTag, InSitu]:
    """A law whose fibres are stretched in situ."""
    inner, made = t.one("elastic"), t.one("prestrain")
    if inner is None or made is None:
        raise t.fault("expected <elastic> and <prestrain>")
    if inner.attribute("type") != MATRICES[1]:
        raise inner.fault(f"prestrain is read of {MATRICES[1]} alone")
    if made.attribute("type") != "in-situ stretch":
        raise made.fault("prestrain is read as an in-situ stretch alone")
    if made.one("stretch") is None:
        raise made.fault("the parameter <stretch> is missing")
    stretch = made.value("stretch", 0.0)
    if not (np.isfinite(stretch) and stretch > 0):
        raise made.fault(f"the stretch must be positive, got {stretch:g}")
    isochoric = made.value("isochoric", 1.0) != 0
    return _read(inner, stress, values, t), inner, InSitu(stretch, isochoric)


def _mixture(t: FebTag, stress: float, values: Values) -> tuple[Law, FebTag]:
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
    law = _read(matrices[0], stress, values, t)
    holder = fibres[0] if plain else matrices[0]
    if plain:
        with fibres[0].naming_place():
            law = replace(law, **vars(_read(fibres[0], stress, values)))
    if families == 1:
        return law, holder
    with t.naming_place():
        return CrossedFibres(
            law, _read(fibres[-1], stress, values), _turn(holder, fibres[-1])
        ), holder


def _turn(first: FebTag, second: FebTag) -> float:
    """The turn (rad) from one solid's fibre to another's, right-handed about material axis 3."""
    (a, b, c), (x, y, z) = (fibre_in_axes(t) for t in (first, second))
    if abs(c) + abs(z) > OFF_PLANE:
        raise second.fault("the fibres of a mixture must lie in the sheet: x, y, 0")
    return float(np.arctan2(a * y - b * x, a * x + b * y))


def fibre_in_axes(t: FebTag) -> list[float]:
    """A solid's fibre in the material axes.  Raises InputError where it is no vector."""
    fibre = t.one("fiber")
    if fibre is None:
        return [1.0, 0.0, 0.0]
    if fibre.attributes.get("type", "vector") != "vector":
        raise fibre.fault("in a mixture of two fibre families a fibre is read as a vector alone")
    return (fibre.one("vector") or fibre).numbers(3)


def softer(law: Any, factor: float) -> Any:
    """The law with all of its moduli times a factor.  Raises InputError for one that FEBio has no
    material for."""
    if type(law) is CrossedFibres:
        return replace(law, base=softer(law.base, factor), second=softer(law.second, factor))
    feb = next((f for f in LAWS if f.make is type(law)), None)
    if feb is None:
        raise InputError(f"FEBio has no material like {type(law).__name__}")
    moduli = {p.field: getattr(law, p.field) for p in feb.parameters if p.unit == "stress"}
    return replace(law, **{k: v if v is None else factor * v for k, v in moduli.items()})


def law_tag(
    number: int, name: str, law: Law, stress: float, in_situ: InSitu | None = None
) -> Element:
    """A material in units of `stress` Pa.

    Raises InputError for a law that FEBio has no material for, and for one that varies within its
    part."""
    if in_situ is not None and in_situ.stretch != 1.0:
        kind, inner = _prestrain_tags(name, law, stress, in_situ)
    elif isinstance(law, CrossedFibres):
        kind, inner = _mixture_tags(name, law, stress)
    else:
        kind, values = _parameters(name, law, stress)
        inner = [*_tags(values), *([_fibre(0.0)] if isinstance(law, TransIsoMooneyRivlin) else [])]
    return tag("material", tag("density", 1), *inner, id=number, name=name, type=kind)


def _tags(values: Mapping[str, float]) -> list[Element]:
    return [tag(name, value) for name, value in values.items()]


def _fibre(angle: float) -> Element:
    """A fibre at an angle (rad) to axis 1 in the sheet."""
    return tag("fiber", tag("vector", (np.cos(angle), np.sin(angle), 0)), type="vector")


def _mixture_tags(name: str, law: CrossedFibres, stress: float) -> tuple[str, list[Element]]:
    """The first law and the second family's fibres, side by side; the volume is the mixture's."""
    if not isinstance(law.base, TransIsoMooneyRivlin):
        raise InputError(
            f"part {name!r}: FEBio's Holzapfel-Gasser-Ogden has two families of the same numbers "
            "alone; write those as its angle, without a second family"
        )
    kind, values = _parameters(name, law.base, stress)
    volume = values.pop("k")
    second, fibres = _parameters(name, law.second, stress)
    return MIXTURE, [
        tag("k", volume),
        tag("solid", *_tags(values), _fibre(0.0), type=kind),
        tag("solid", *_tags(fibres), _fibre(_one(name, law.angle)), type=second),
    ]


def _prestrain_tags(
    name: str, law: Law, stress: float, in_situ: InSitu
) -> tuple[str, list[Element]]:
    if not isinstance(law, TransIsoMooneyRivlin):
        raise InputError(
            f"part {name!r}: FEBio stretches in situ only what has one fibre of its own, of these "
            "laws trans iso Mooney-Rivlin with one family; set in_situ_stretch to 1"
        )
    kind, values = _parameters(name, law, stress)
    volume = values.pop("k")
    made = (tag("stretch", in_situ.stretch), tag("isochoric", in_situ.isochoric))
    return PRESTRAIN, [
        tag("k", volume),
        tag("elastic", *_tags(values), _fibre(0.0), type=kind),
        tag("prestrain", *made, type="in-situ stretch"),
    ]


def _one(name: str, value: Real) -> float:
    if np.size(value) != 1:
        raise InputError(f"part {name!r}: a material that varies within it cannot be written")
    number = float(np.asarray(value).item())
    if not np.isfinite(number):
        raise InputError(f"part {name!r}: FEBio needs a finite bulk modulus k")
    return number


def _parameters(name: str, law: object, stress: float) -> tuple[str, dict[str, float]]:
    """The material's type, and its parameters by tag."""
    if isinstance(law, CrossedLinear):
        raise InputError(
            f"part {name!r}: FEBio has no linear material with two fibre families; take "
            "trans iso Mooney-Rivlin fibres, or leave the second family out"
        )
    feb = next((f for f in LAWS if f.make is type(law)), None)
    if feb is None:
        raise InputError(f"part {name!r}: FEBio has no material like {type(law).__name__}")
    values: dict[str, float] = {}
    for p in feb.parameters:
        value = getattr(law, p.field)
        if value is None and p.like:
            values[p.tag] = values[p.like]
        else:
            values[p.tag] = _one(name, value) / p.factor(stress)
    return feb.kind, values
