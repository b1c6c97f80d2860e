"""The numbers that summaries of runs hold: which a run may lack, and which are misspelt.

No run has them all: a hood of cables has no strain of a sheet, a motion no unloaded state, and of a
slack central slip no ratio is told.  A quantity that a run lacks is known where another may have
it, and refused where none can.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cosim.errors import InputError, nearest_names
from cosim.port import AXES
from cosim.results.compare import Target, parts_of
from cosim.results.conventions import OPPOSITE
from cosim.schema.fields import is_number
from cosim.schema.types import TENDONS
from meshes.bands import SIDES
from meshes.glide import PLACES
from meshes.hood_mesh import REGIONS, SPRINGS
from meshes.skeleton import BODIES, JOINTS

NAMES: Mapping[str, tuple[str, ...]] = {
    "<joint>": JOINTS,
    "<tendon>": TENDONS,
    "<axis>": (*AXES, *OPPOSITE),
    "<region>": REGIONS,
    "<direction>": ("longitudinal", "lateral"),
    "<component>": ("longitudinal", "lateral", "shear"),
    "<statistic>": ("min", "mean", "max"),
    "<slip>": ("central", "terminal"),
    "<tension>": ("taut", "wrinkled", "slack"),
    "<place>": PLACES,
    "<side>": SIDES,
    "<pair>": ("MCP_PIP", "PIP_DIP"),
    "<springs>": (*SPRINGS, *(f"adhesion_{r}_{body}" for r in REGIONS for body in BODIES)),
    "<beside>": ("at_rest", "change"),
    "<torque>": ("hood", "gravity", "passive", "limit", "fingertip", "holder", *TENDONS),
}
"""What stands for a key of a path."""
ANY = "*"
"""Any name: a case file may choose it."""
RENAMED = {"drawn_mm": "prescribed_excursion_mm"}
"""Keys of earlier versions, and what they are called now."""
BY_PLACE = {"0": "distal", "1": "palmar", "2": "radial"}
"""The places of components in the vectors of earlier versions."""
STATE = (
    "posture_deg.<joint>",
    "tension_N.<tendon>",
    "excursion_mm.<tendon>",
    "fingertip_force_N.<axis>",
    "fingertip_force_in_phalanx_N.<axis>",
    "fingertip_magnitude_N",
    "fingertip_moment_Nmm.<axis>",
    "moment_arm_mm.<tendon>.<joint>",
    "joint_torque_Nmm.<torque>.<joint>",
    "joint_force_N.<joint>.<axis>",
    "joints_at_limit.<joint>.limit_deg",
    "joints_at_limit.<joint>.angle_deg",
    "joints_at_limit.<joint>.limit_torque_Nmm",
    "slip_force_N.<slip>",
    "slip_ratio",
    "glide_mm.<place>",
    "lateral_band_height_mm.<side>",
    "spring_force_N.<springs>",
    "cable.*.tension_N",
    "cable.*.mean_strain_percent",
    "strain_percent.<direction>.<statistic>",
    "region_strain_percent.<region>.<direction>.<statistic>",
    "region_force_N.<region>",
    "strip_arm_mm.<region>",
    "point_displacement_mm.*.<axis>",
    "point_strain_percent.*.<component>",
    "gauge_strain_percent.*",
    "grid_strain_percent.*.<direction>.<statistic>",
    "tension_field_area_percent.<tension>",
    "max_penetration_mm",
    "guide_depth_mm",
    "hood_unstable_modes",
)
"""What a summary says of an equilibrium, loaded or `unloaded`, or of the end of a motion."""
DIFFERENCE = (
    "posture_deg.<joint>",
    "fingertip_force_N.<axis>",
    "fingertip_force_in_phalanx_N.<axis>",
    "fingertip_magnitude_N",
    "slip_force_N.<slip>",
    "strain_percent.<direction>.<statistic>",
    "engineering_strain_percent.<direction>.<statistic>",
    "region_engineering_strain_percent.<region>.<direction>.<statistic>",
    "marker_strain_percent.<direction>.<statistic>",
    "point_displacement_mm.*.<axis>",
    "point_strain_percent.*.<component>",
    "gauge_strain_percent.*",
    "grid_strain_percent.*.<direction>.<statistic>",
    "moment_arm_mm.<tendon>.<joint>",
    "arm_difference_mm.<pair>",
    "abduction_arm_mm",
)
"""What a summary says of the loaded less the unloaded equilibrium."""
OF_RUN = (
    "wall_s",
    "hood_quads",
    "hood_cells",
    "joints_at_limit.<joint>.first_s",
    "last_rate_rad_per_s",
    "last_force_change_N",
    "largest_interface_residual",
    "prescribed_excursion_mm.<tendon>",
    "air.<tendon>.command_V",
    "air.<tendon>.pressure_kPa",
    "muscle.<tendon>.activation",
    "muscle.<tendon>.normalised_fibre_length",
    "muscle.<tendon>.assumed_normalised_fibre_length_unloaded",
    "muscle.<tendon>.pennation_deg",
    "energy_mJ.tendons",
    "energy_mJ.own_tendons",
    "energy_mJ.gravity",
    "energy_mJ.kinetic",
    "energy_mJ.finger",
    "energy_mJ.hood_stored",
    "energy_mJ.joints_stored",
    "energy_mJ.device_stored",
    "energy_mJ.joints_dissipated",
    "energy_mJ.device_dissipated",
    "energy_mJ.artificial",
    "audit.hood_force_balance",
    "audit.hood_moment_balance",
    "audit.finger_residual",
    "audit.interface_residual",
    "audit.reciprocity",
    "audit.torque_balance_at_rest",
    "audit.artificial_energy_over_effort",
    "audit.energy_put_in_over_effort",
    "audit.last_turn_rad",
    "iterations.coupling",
    "iterations.newton",
    "iterations.steps",
    "iterations.hood_solves",
    "step_control.accepted",
    "step_control.rejected",
    "step_control.largest_error_deg",
    "step_control.shortest_half_ms",
    "step_control.longest_half_ms",
    "rest.fingertip_force_N.<beside>",
    "rest.hood_torque_Nmm.<beside>",
    "rest.slip_force_N.<beside>",
    "one_way.interface_residual",
    "one_way.handed_over_force_balance",
    "one_way.handed_over_moment_balance",
    "one_way.joint_torque_Nmm.*.<joint>",
)
PATTERNS = tuple(
    tuple(path.split("."))
    for path in (
        *STATE,
        *(f"unloaded.{path}" for path in STATE),
        *(f"difference.{path}" for path in DIFFERENCE),
        *OF_RUN,
    )
)
Summaries = Sequence[Mapping[str, Any]]
Keys = Sequence[str]
ABSENT = object()


def check_quantities(
    targets: Sequence[Target], runs: Sequence[tuple[str, Mapping[str, Any]]]
) -> None:
    """Refuse a quantity that no run can have; runs: case and summary of each.

    A quantity that one of the runs has is right for all of them.  Raises InputError, with the
    nearest name and the names that stand in its place."""
    for target in targets:
        summaries = [summary for case, summary in runs if target.case in ("", case)]
        if summaries and (fault := _fault(target.quantity.split("."), summaries)):
            raise InputError(f"{target.name}: quantity {target.quantity}: {fault}")


def is_known(quantity: str, summaries: Summaries = ()) -> bool:
    """Whether one of these runs has a number there, or null, or another run can have one."""
    keys = quantity.split(".")
    return any(_is_number(_at(summary, keys)) for summary in summaries) or any(
        len(pattern) == len(keys) and _begins(pattern, keys, summaries) for pattern in PATTERNS
    )


def _fault(keys: Keys, summaries: Summaries) -> str | None:
    """What is wrong with a path, if anything."""
    if is_known(".".join(keys), summaries):
        return None
    for i, key in enumerate(keys):
        above = keys[:i]
        if key in BY_PLACE and set(_present(above, summaries)) >= set(AXES):
            named = ".".join([*above, BY_PLACE[key]])
            return f"components go by axis, not by place: {named} in place of {'.'.join(keys)}"
        place = f"in {'.'.join(above)}" if above else "in a summary"
        if key in RENAMED:
            return f"{key} is now called {RENAMED[key]}"
        names = _names(above, key, summaries)
        if not names:
            return f"there is nothing {place}"
        if key not in names:
            nearest = ".".join([*above, nearest_names(key, names, share=1.0)[0], *keys[i + 1 :]])
            listed = _list_quantities(_present(above, summaries) or names)
            return f'no "{key}" {place}; did you mean {nearest}? There are {listed}'
    inner = _names(keys, "", summaries)
    return "that is no number" + (f"; it has the parts {_list_quantities(inner)}" if inner else "")


def _names(above: Keys, key: str, summaries: Summaries) -> list[str]:
    """The names that can follow a path, those of the runs first; where a case may choose them and
    these runs have none, `key` is one."""
    present = _present(above, summaries)
    known = [*present]
    for pattern in PATTERNS:
        if len(pattern) > len(above) and _begins(pattern, above, summaries):
            part = pattern[len(above)]
            chosen = () if present or not key else (key,)
            known += chosen if part == ANY else _choices(part, summaries)
    return list(dict.fromkeys(known))


def _begins(pattern: Keys, keys: Keys, summaries: Summaries) -> bool:
    """Whether the pattern begins with the keys.  A name that a case may choose is one of those of
    the runs, where they have names there."""
    for i, (part, key) in enumerate(zip(pattern, keys, strict=False)):
        if part == ANY:
            choices: Iterable[str] = _present(keys[:i], summaries) or [key]
        else:
            choices = _choices(part, summaries)
        if key not in choices:
            return False
    return True


def _choices(part: str, summaries: Summaries) -> tuple[str, ...]:
    """The keys that a part of a pattern stands for; a finger in an FMU names its own joints."""
    own = _present(["posture_deg"], summaries) if part == "<joint>" else ()
    return (*NAMES.get(part, (part,)), *own)


def _present(keys: Keys, summaries: Summaries) -> list[str]:
    """What the runs have at a path."""
    return list(dict.fromkeys(name for s in summaries for name in parts_of(_at(s, keys))))


def _at(summary: Mapping[str, Any], keys: Keys) -> Any:
    """The value at a path, ABSENT where there is none."""
    value: Any = summary
    for key in keys:
        value = parts_of(value).get(key, ABSENT)
    return value


def _is_number(value: Any) -> bool:
    return value is None or is_number(value)


def _list_quantities(names: Iterable[str]) -> str:
    return ", ".join(name for name in names if not name.isdigit())
