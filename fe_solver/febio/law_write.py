"""Our laws as FEBio's materials."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np

from cosim.port import InputError

from ..fibre_materials import HolzapfelGasserOgden, TransIsoMooneyRivlin
from ..hyperelastic import NeoHookean
from ..materials import Isotropic, Law, Orthotropic, Real

FIELDS = ("E1", "E2", "nu12", "G12", "G13", "G23", "nu23", "nu31")


def oriented(law: Law) -> bool:
    """Whether the law's answer depends on the fibre direction."""
    return isinstance(law, TransIsoMooneyRivlin | HolzapfelGasserOgden | Orthotropic)


def law_line(number: int, name: str, law: Law, stress: float) -> str:
    """A material in units of `stress` Pa.

    Raises InputError for a law that FEBio has no material for, and for one that varies within its
    part."""
    kind, values = _parameters(name, law, stress)
    inner = "".join(f"<{k}>{float(v)!r}</{k}>" for k, v in values.items())
    if isinstance(law, TransIsoMooneyRivlin):
        inner += '<fiber type="vector"><vector>1,0,0</vector></fiber>'
    return (
        f'<material id="{number}" name={quoteattr(name)} type="{kind}"><density>1</density>'
        f"{inner}</material>"
    )


def _parameters(name: str, law: Law, s: float) -> tuple[str, dict[str, float]]:
    def one(value: Real) -> float:
        if np.size(value) != 1:
            raise InputError(f"part {name!r}: a material that varies within it cannot be written")
        number = float(np.asarray(value).item())
        if not np.isfinite(number):
            raise InputError(f"part {name!r}: FEBio needs a finite bulk modulus k")
        return number

    if isinstance(law, Isotropic):
        return "isotropic elastic", {"E": one(law.E) / s, "v": one(law.nu)}
    if isinstance(law, NeoHookean):
        return "neo-Hookean", {"E": one(law.E) / s, "v": one(law.nu)}
    if isinstance(law, TransIsoMooneyRivlin):
        out = {n: one(getattr(law, n)) for n in ("c1", "c2", "c3", "c4", "c5", "lam_max", "k")}
        pure = ("c4", "lam_max")
        return "trans iso Mooney-Rivlin", {k: v if k in pure else v / s for k, v in out.items()}
    if isinstance(law, HolzapfelGasserOgden):
        out = {n: one(getattr(law, n)) for n in ("c", "k1", "k2", "kappa", "gamma", "k")}
        out["gamma"] = float(np.degrees(out["gamma"]))
        scaled = ("c", "k1", "k")
        return "Holzapfel-Gasser-Ogden", {k: v / s if k in scaled else v for k, v in out.items()}
    if isinstance(law, Orthotropic):
        out = {n: one(getattr(law, n)) for n in FIELDS}
        out["E3"] = out["E2"] if law.E3 is None else one(law.E3)
        return "orthotropic elastic", _orthotropic(out, s)
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
