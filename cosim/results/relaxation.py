"""What the time under load changed, where parts relax: in numbers, in arrays and in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cosim.results.conventions import by_name
from cosim.results.give_way import in_words
from cosim.results.parts import force_block
from cosim.solve.held import Held


def held_block(held: Held | None, tendons: tuple[str, ...]) -> dict[str, Any]:
    """What there was as the load was put on, and for how long it has been held."""
    if held is None:
        return {}
    force, tension = held.tip_force[0], held.tension[0]
    at_once: dict[str, Any] = {
        **force_block(force),
        "tension_N": by_name(tendons, tension),
    }
    if held.slips:
        at_once["slip_force_N"] = {name: float(force[0]) for name, force in held.slips.items()}
    out = {"time_s": float(held.time[-1]), "at_once": at_once}
    if held.repairs:
        each = {name: 1e3 * longer for name, longer in held.repairs.items()}
        at_once["repair_stretch_mm"] = {name: float(mm[0]) for name, mm in each.items()}
        out["repair_stretch_mm"] = {name: float(mm[-1]) for name, mm in each.items()}
    return {"held": out}


def held_arrays(held: Held | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """The same over the time under load: variables and coordinates of a run's arrays."""
    if held is None:
        return {}, {}
    own = held.excursion.shape[1]
    each = {
        "tip_force": (("axis",), held.tip_force, "N", "force of the tip on the world"),
        "tension": (("tendon",), held.tension[:, :own], "N", "tension"),
        "own_tension": (("muscle",), held.tension[:, own:], "N", "tension of the finger's tendons"),
        "excursion": (("tendon",), held.excursion, "m", "excursion, positive proximally"),
        "angle": (("joint",), held.angles, "rad", "joint angle"),
    }
    coords: dict[str, Any] = {"held_time": held.time}
    for key, unit, values in (("slip", "N", held.slips), ("repair", "m", held.repairs)):
        if values:
            name = f"{key}_force" if key == "slip" else f"{key}_stretch"
            what = {"slip": "force in the slip", "repair": "how much longer than at rest it is"}
            each[name] = ((f"held_{key}",), np.stack([*values.values()], axis=1), unit, what[key])
            coords[f"held_{key}"] = [*values]
    data = {
        f"held_{name}": (
            ("held_time", *dims),
            values,
            {"units": unit, "long_name": f"{meaning}, while the load is held"},
        )
        for name, (dims, values, unit, meaning) in each.items()
    }
    return data, coords


def held_sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """Say what the time under load changed."""
    if (held := summary.get("held")) is None:
        return
    before, after = held["at_once"], summary
    size = before["fingertip_magnitude_N"], after["fingertip_magnitude_N"]
    changes = [f"the fingertip force from {size[0]:.3g} to {size[1]:.3g} N"] if size[0] else []
    for name, force in before.get("slip_force_N", {}).items():
        changes.append(f"the {name} slip from {force:.3g} to {after['slip_force_N'][name]:.3g} N")
    for name, tension in before["tension_N"].items():
        if abs(after["tension_N"][name] - tension) > 1e-9:
            changes.append(f"{name} from {tension:.3g} to {after['tension_N'][name]:.3g} N")
    for name, mm in before.get("repair_stretch_mm", {}).items():
        changes.append(
            f"{in_words(name)} longer by {mm:.3g} and {held['repair_stretch_mm'][name]:.3g} mm"
        )
    yield f"In {held['time_s']:.4g} s under load, in which parts relaxed: {', '.join(changes)}."
