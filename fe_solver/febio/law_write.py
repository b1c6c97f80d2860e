"""Our laws as FEBio's materials."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np

from cosim.errors import InputError
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import ExponentialFamily, HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Law, Orthotropic, Real

FIELDS = ("E1", "E2", "nu12", "G12", "G13", "G23", "nu23", "nu31")


def needs_fibre(law: Law) -> bool:
    """Whether the law's answer depends on the fibre direction."""
    fibrous = TransIsoMooneyRivlin | HolzapfelGasserOgden | Orthotropic
    return isinstance(law, fibrous | CrossedFibres | CrossedLinear)


def law_line(number: int, name: str, law: Law, stress: float, in_situ_stretch: float = 1.0) -> str:
    """A material in units of `stress` Pa.

    Raises InputError for a law that FEBio has no material for, and for one that varies within its
    part."""
    kind, inner = _material(name, law, stress)
    if in_situ_stretch != 1.0:
        kind, inner = _prestrain_text(name, law, stress, in_situ_stretch)
    return (
        f'<material id="{number}" name={quoteattr(name)} type="{kind}"><density>1</density>'
        f"{inner}</material>"
    )


def _material(name: str, law: Law, stress: float) -> tuple[str, str]:
    """The material's type and what stands in it."""
    match law:
        case CrossedFibres():
            return _mixture(name, law, stress)
        case TransIsoMooneyRivlin():
            kind, values = _parameters(name, law, stress)
            return kind, _tags(values) + _fibre(1.0, 0.0)
        case _:
            kind, values = _parameters(name, law, stress)
            return kind, _tags(values)


def _tags(values: dict[str, float]) -> str:
    return "".join(f"<{k}>{float(v)!r}</{k}>" for k, v in values.items())


def _fibre(along: float, across: float) -> str:
    return f'<fiber type="vector"><vector>{along!r},{across!r},0</vector></fiber>'


def _mixture(name: str, law: CrossedFibres, stress: float) -> tuple[str, str]:
    """The first law and the second family's fibres, side by side; the volume is the mixture's."""
    if not isinstance(law.base, TransIsoMooneyRivlin):
        raise InputError(
            f"part {name!r}: FEBio's Holzapfel-Gasser-Ogden has two families of the same numbers "
            "alone; write those as its angle, without a second family"
        )
    assert isinstance(law.second, ExponentialFamily)  # the family of this base
    kind, values = _parameters(name, law.base, stress)
    volume, angle = values.pop("k"), _one(name, law.angle)
    second = {n: _one(name, getattr(law.second, n)) for n in ("c3", "c4", "c5", "lam_max")}
    fibres = {
        "c3": second["c3"] / stress,
        "c4": second["c4"],
        "c5": second["c5"] / stress,
        "lambda": second["lam_max"],
    }
    return "uncoupled solid mixture", (
        f"{_tags({'k': volume})}"
        f'<solid type="{kind}">{_tags(values)}{_fibre(1.0, 0.0)}</solid>'
        f'<solid type="uncoupled fiber-exp-linear">{_tags(fibres)}'
        f"{_fibre(float(np.cos(angle)), float(np.sin(angle)))}</solid>"
    )


def _prestrain_text(name: str, law: Law, stress: float, stretch: float) -> tuple[str, str]:
    if not isinstance(law, TransIsoMooneyRivlin):
        raise InputError(
            f"part {name!r}: FEBio stretches in situ only what has one fibre of its own, of these "
            "laws trans iso Mooney-Rivlin with one family; set in_situ_stretch to 1"
        )
    kind, values = _parameters(name, law, stress)
    volume = values.pop("k")
    return "uncoupled prestrain elastic", (
        f"{_tags({'k': volume})}"
        f'<elastic type="{kind}">{_tags(values)}{_fibre(1.0, 0.0)}</elastic>'
        f'<prestrain type="in-situ stretch">{_tags({"stretch": stretch})}'
        "<isochoric>1</isochoric></prestrain>"
    )


def _one(name: str, value: Real) -> float:
    if np.size(value) != 1:
        raise InputError(f"part {name!r}: a material that varies within it cannot be written")
    number = float(np.asarray(value).item())
    if not np.isfinite(number):
        raise InputError(f"part {name!r}: FEBio needs a finite bulk modulus k")
    return number


def _parameters(name: str, law: Law, s: float) -> tuple[str, dict[str, float]]:
    def one(value: Real) -> float:
        return _one(name, value)

    match law:
        case Isotropic():
            return "isotropic elastic", {"E": one(law.E) / s, "v": one(law.nu)}
        case NeoHookean():
            return "neo-Hookean", {"E": one(law.E) / s, "v": one(law.nu)}
        case TransIsoMooneyRivlin():
            out = {n: one(getattr(law, n)) for n in ("c1", "c2", "c3", "c4", "c5", "lam_max", "k")}
            pure = ("c4", "lam_max")
            numbers = {k: v if k in pure else v / s for k, v in out.items()}
            return "trans iso Mooney-Rivlin", numbers
        case HolzapfelGasserOgden():
            out = {n: one(getattr(law, n)) for n in ("c", "k1", "k2", "kappa", "gamma", "k")}
            out["gamma"] = float(np.degrees(out["gamma"]))
            scaled = ("c", "k1", "k")
            numbers = {k: v / s if k in scaled else v for k, v in out.items()}
            return "Holzapfel-Gasser-Ogden", numbers
        case Orthotropic():
            out = {n: one(getattr(law, n)) for n in FIELDS}
            out["E3"] = out["E2"] if law.E3 is None else one(law.E3)
            return "orthotropic elastic", _orthotropic(out, s)
        case CrossedLinear():
            raise InputError(
                f"part {name!r}: FEBio has no linear material with two fibre families; take "
                "trans iso Mooney-Rivlin fibres, or leave the second family out"
            )
    raise InputError(f"part {name!r}: FEBio has no material like {type(law).__name__}")


def _orthotropic(p: dict[str, float], s: float) -> dict[str, float]:
    return {
        "E1": p["E1"] / s,
        "E2": p["E2"] / s,
        "E3": p["E3"] / s,
        "v12": p["nu12"],
        "v23": p["nu23"],
        "v31": p["nu31"],
        "G12": p["G12"] / s,
        "G23": p["G23"] / s,
        "G31": p["G13"] / s,
    }
