"""The models that stand for those of Jadelis's thesis, each run once, and their numbers by name.

The finite-element hood of the thesis is one isotropic sheet with the moduli of its table 4: here
`thesis_strain_*` and, in its one-way pass, `thesis_one_way_*`.  Its dynamic model alone is the
fixed split of `split_*` and, in its two fingertip devices, `forward_*`."""

from __future__ import annotations

from functools import lru_cache
from statistics import median
from typing import cast

import numpy as np

from cosim.analyses.opensim.loads import THESIS_AXES, axes_of
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.fingers.common import CageTipConfig
from cosim.hoods.shell.table import IsotropicConfig, ShellHoodConfig
from cosim.pipeline import run_case
from cosim.port import Array
from cosim.results.result import Result

MESH: tuple[str, ...] = ()
"""Settings of every hood's mesh; none, as the cases ship."""
MUSCLES = ("EDC", "EI", "LUM", "FPI", "FDP", "FDS", "FDI")
INTEGRATED = ("EDC", "EI", "LUM", "FPI")
"""Whose integrated simulations the thesis has."""
EXCESS = {"EDC": 4.69, "EI": 4.66, "LUM": 1.76, "FPI": 0.19}
"""N over the experiment's mean, of the one-way pass (thesis, section 3.4)."""
OVER_ALONE = {
    **{m: (EXCESS[m] - 0.53, EXCESS[m] + 0.53) for m in ("EDC", "EI", "LUM")},
    "FPI": (EXCESS["FPI"] - 0.53, EXCESS["FPI"] - 0.51),
}
"""N, least and most, of the one-way pass less the dynamic model alone, which lies within 0.53 N
of the same experiment, FPI's over it by 0.53 (cage) and 0.51 N (hollow sphere) (section 3.2)."""
MODULI = ("soft", "average", "stiff")
DEVICES = ("cage", "shell")
DIRECTIONS = ("longitudinal", "lateral")
STATISTICS = ("min", "mean", "max")
SHEET = "base/one_sheet.toml"
IDLE = 'solve.resting_tension="0 N"'
"""Muscles but the one are off, as in the thesis's table 3 (its own cases say so themselves)."""
POINT, ONE_WAY, SAME, OURS = "dynamic model alone", "one way", "two-way, one sheet", "two-way, ours"
LOCATIONS = {
    "Lateral Bands": "lateral_band_radial",
    "Sagittal Band": "sagittal_band_radial",
    "Central Slip": "central_slip",
    "Terminal Slip": "terminal_slip",
    "Central Band": "central_band",
    "Proximal to MCP": "extensor_tendon_proximal",
    "Distal to MCP": "extensor_tendon_distal",
}
"""The region of ours for each row of table 4."""
Numbers = dict[str, tuple[float, ...]]


@lru_cache(maxsize=64)
def run_once(name: str, *settings: str) -> Result:
    """The run of a case.  Raises ConvergenceError."""
    return run_case(load_case(name, ("output.picture=false", *settings)))


def hood_run(name: str, *settings: str) -> Result:
    """The run of a case with a hood, on its mesh."""
    return run_once(name, *MESH, *settings)


def device_run(muscle: str, device: str) -> Result:
    """2 s of the dynamic model alone, the fingertip in a device."""
    return run_once(f"forward_{muscle.lower()}", f'finger.tip.kind="{device}"')


def force_run(muscle: str, model: str) -> Result:
    """The equilibrium of a muscle alone at 10 % (FDI 5 %), the fingertip held at a point."""
    low = muscle.lower()
    if model == POINT:
        return run_once(f"split_{low}", IDLE)
    if model == ONE_WAY:
        return hood_run(f"thesis_one_way_{low}")
    if model == SAME:
        return hood_run(SHEET, f"tendons.{muscle}.activation=0.1", IDLE)
    return hood_run(f"isometric_{low}")


def tip_force(result: Result) -> Array:
    """(3,) N of the fingertip on the world in the order of the thesis: distal, palmar, radial."""
    force = result.tip_force
    return np.array([force["distal"], -force["dorsal"], force["radial"]])


def magnitude(result: Result) -> float:
    """N."""
    return float(result.summary["fingertip_magnitude_N"])


def device_numbers() -> Numbers:
    """N, the fingertip force's magnitude in the cage less that in the hollow sphere."""
    apart = {
        m: magnitude(device_run(m, "cage")) - magnitude(device_run(m, "shell")) for m in MUSCLES
    }
    each = {f"device.{m}": (abs(x),) for m, x in apart.items()}
    return {"device.most": (max(abs(x) for x in apart.values()),), **each}


def force_numbers() -> Numbers:
    """N: the one-way pass beyond the two-way equilibrium of the same hood, and beyond the dynamic
    model alone."""
    out: Numbers = {}
    for muscle in INTEGRATED:
        once = magnitude(force_run(muscle, ONE_WAY))
        out[f"excess.{muscle}"] = (once - magnitude(force_run(muscle, SAME)),)
        out[f"over_alone.{muscle}"] = (once - magnitude(force_run(muscle, POINT)),)
    return out


def strain_numbers() -> Numbers:
    """%: Green-Lagrange strains of the loaded sheet over the central region, by moduli, and means
    over the slips with what the moduli change in them."""
    out: Numbers = {}
    slips: dict[tuple[str, str], float] = {}
    for moduli in MODULI:
        said = hood_run(f"thesis_strain_{moduli}").summary
        for direction in DIRECTIONS:
            for statistic, value in said["strain_percent"][direction].items():
                out[f"strain.{moduli}.{direction}.{statistic}"] = (float(value),)
        for slip in ("central", "terminal"):
            mean = said["region_strain_percent"][f"{slip}_slip"]["longitudinal"]["mean"]
            slips[slip, moduli] = float(mean)
    for (slip, moduli), value in slips.items():
        out[f"slip.{slip}.{moduli}"] = (value,)
        out[f"slip.{slip}.{moduli}_less_soft"] = (value - slips[slip, "soft"],)
    return out


def time_numbers() -> Numbers:
    """s of wall time, medians over the muscles: a simulation of 2 s in each device, a one-way pass
    with its hood; and the devices' ratio."""
    out = {
        f"time.{d}": (median(device_run(m, d).summary["wall_s"] for m in MUSCLES),) for d in DEVICES
    }
    passes = median(force_run(m, ONE_WAY).summary["wall_s"] for m in INTEGRATED)
    return {
        **out,
        "time.pass": (passes,),
        "time.cage_over_shell": (out["time.cage"][0] / out["time.shell"][0],),
    }


def input_numbers() -> Numbers:
    """What our cases take from the thesis, as they hold it, in the thesis's units."""
    out: Numbers = {
        f"axes.{axis}": tuple(row.tolist())
        for axis, row in zip("xyz", axes_of(THESIS_AXES), strict=True)
    }
    for name, tendon in load_case("base/muscles.toml").tendons.items():
        if tendon.muscle is not None and tendon.max_force is not None:
            m = tendon.muscle
            lengths = (m.optimal_fibre_length, m.tendon_slack_length)
            out[f"muscle.{name}"] = (tendon.max_force, *lengths, float(np.degrees(m.pennation)))
    hoods = {k: _hood(load_case(f"thesis_strain_{k}")) for k in MODULI}
    for place, region in LOCATIONS.items():
        soft, mean, stiff = (_modulus(hoods[k], region) for k in MODULI)
        out[f"modulus.{place}"] = (mean, (stiff - soft) / 2)
    return out | _settings(load_case("forward_edc"))


def _settings(forward: Case) -> Numbers:
    finger, hood = forward.native_finger(), _hood(load_case("thesis_one_way_edc"))
    assert finger.limit is not None
    assert forward.forward is not None
    tip, limit = cast(CageTipConfig, finger.tip), finger.limit
    posture = finger.posture.angles()
    tension = load_case("thesis_strain_average").tendons["EDC"].tension
    activation = forward.tendons["EDC"].activation
    assert tension is not None
    assert activation is not None
    stiffness = {name: spring.stiffness / 1e3 for name, spring in hood.springs.items()}
    return {
        "activation.EDC": (100 * activation,),
        "tension.others": (forward.solve.resting_tension,),
        "device.gap": (1e3 * (tip.width - tip.sphere) / 2,),
        "device.size": (1e3 * tip.sphere, 1e3 * tip.width),
        "device.law": (
            tip.stiffness / 1e9,
            tip.dissipation,
            tip.static_friction,
            tip.dynamic_friction,
            tip.viscous_friction,
        ),
        "limit.range": (float(np.degrees(limit.half_range)),),
        "limit.law": (
            float(np.radians(limit.stiffness)),
            float(np.radians(limit.damping)),
            float(np.degrees(limit.transition)),
        ),
        "posture": tuple(float(np.degrees(posture[j])) for j in ("MCP", "PIP", "DIP")),
        "duration": (forward.forward.duration,),
        "spring.central_slip": (stiffness["central_slip"],),
        "spring.ligament": (stiffness["ligament_radial"],),
        "strain.load": (tension,),
    }


def _hood(case: Case) -> ShellHoodConfig:
    return cast(ShellHoodConfig, case.hood)


def _modulus(hood: ShellHoodConfig, name: str) -> float:
    """MPa."""
    return cast(IsotropicConfig, hood.regions[name]).modulus / 1e6


def all_numbers() -> Numbers:
    """Everything that a row of the thesis is compared with."""
    return {
        **input_numbers(),
        **device_numbers(),
        **force_numbers(),
        **strain_numbers(),
        **time_numbers(),
    }
