"""The numbers that summaries of runs hold: which a run may lack, and which are misspelt.

No run has them all: a hood of cables has no strain of a sheet, a motion no unloaded state, and a
slack central slip no ratio.  A quantity that a run lacks is accepted if another run may have it,
and refused if none can.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from cosim.errors import InputError, nearest_names
from cosim.port import AXES
from cosim.results.compare import Target, numbers_of, parts_of
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
    "<strip>": ("central_slip", "lateral_band_radial", "lateral_band_ulnar"),
    "<direction>": ("longitudinal", "lateral"),
    "<component>": ("longitudinal", "lateral", "shear"),
    "<statistic>": ("min", "mean", "max"),
    "<percentile>": ("p5", "mean", "p95"),
    "<extreme>": ("min", "max"),
    "<fibre>": ("p5", "mean", "beyond_straight"),
    "<slip>": ("central", "terminal"),
    "<tension>": ("taut", "wrinkled", "slack"),
    "<place>": PLACES,
    "<side>": SIDES,
    "<pair>": ("MCP_PIP", "PIP_DIP"),
    "<springs>": (*SPRINGS, *(f"adhesion_{r}_{body}" for r in REGIONS for body in BODIES)),
    "<beside>": ("at_rest", "change"),
    "<sliding>": ("loading", "unloading"),
    "<start>": ("first", "second"),
    "<turned>": JOINTS,
    "<torque>": ("hood", "gravity", "passive", "limit", "tie", "fingertip", "holder", *TENDONS),
}
"""What stands for a key of a path."""
ANY = "*"
"""Any name: a case file may choose it."""
RENAMED = {"drawn_mm": "prescribed_excursion_mm"}
"""Keys of earlier versions, and what they are called now."""
BY_PLACE = {"0": "distal", "1": "palmar", "2": "radial"}
"""The places of components in the vectors of earlier versions."""


class Quantity(NamedTuple):
    """A number that a summary may have."""

    path: str
    """Keys joined by dots: `<joint>` and the like stand for one of NAMES, `*` for any name."""
    meaning: str
    """What it is, with the same words in angle brackets."""
    is_asked_first: bool = False
    """Among what one asks for first: the tables of the terminal and of reports begin with it."""


HOOD_TORQUE = "joint_torque_Nmm.hood.<joint>"
FIBRE_STRAIN = "fibre_strain_percent.<region>.p95"
MOST_STRAINED = 3
"""Regions whose strain along the fibres is among what one asks for first."""
STATE = (
    Quantity("fingertip_force_N.<axis>", "fingertip force, <axis>", True),
    Quantity("fingertip_magnitude_N", "fingertip force, magnitude", True),
    Quantity("slip_force_N.<slip>", "force in the <slip> slip", True),
    Quantity(FIBRE_STRAIN, "strain along the fibres of <region>, p95 of its area", True),
    Quantity("fibre_strain_percent.<region>.<fibre>", "strain of the fibres of <region>, <fibre>"),
    Quantity(HOOD_TORQUE, "torque of the hood, <joint>", True),
    Quantity("strip_arm_mm.<strip>", "arm of the force about the PIP, <strip>", True),
    Quantity("strip_arm_mm.terminal_slip", "arm of the force about the DIP, terminal slip", True),
    Quantity("glide_mm.<place>", "glide of the <place>", True),
    Quantity("lateral_band_height_mm.<side>", "height of the <side> lateral band at the PIP", True),
    Quantity("tendon_shift_mm", "shift of the extensor tendon over the MCP, positive radially"),
    Quantity(
        "strain_percent.<direction>.<percentile>",
        "<direction> strain, central region, <percentile>",
        True,
    ),
    Quantity(
        "strain_percent.<direction>.<extreme>",
        "<direction> strain, central region, <extreme> of the gauges at the markers",
    ),
    Quantity("posture_deg.<joint>", "<joint> angle", True),
    Quantity("tension_N.<tendon>", "tension of <tendon>"),
    Quantity("excursion_mm.<tendon>", "excursion of <tendon>, positive proximally"),
    Quantity(
        "own_excursion_mm.<tendon>",
        "excursion of the finger's own <tendon> from the straight finger, positive proximally",
    ),
    Quantity(
        "fingertip_force_in_phalanx_N.<axis>", "fingertip force, <axis> of the distal phalanx"
    ),
    Quantity("fingertip_moment_Nmm.<axis>", "moment of the tip on the world, <axis>"),
    Quantity("moment_arm_mm.<tendon>.<joint>", "moment arm of <tendon> about <joint>"),
    Quantity("joint_torque_Nmm.<torque>.<joint>", "torque of <torque> about <joint>"),
    Quantity("joint_force_N.<joint>.<axis>", "bone-to-bone force at <joint>, <axis>"),
    Quantity("joints_at_limit.<joint>.limit_deg", "limit that <joint> has reached"),
    Quantity("joints_at_limit.<joint>.angle_deg", "angle of <joint> at its limit"),
    Quantity("joints_at_limit.<joint>.limit_torque_Nmm", "torque of the limit on <joint>"),
    Quantity("slip_ratio", "force in the terminal slip over that in the central slip"),
    Quantity("spring_force_N.<springs>", "force of the springs <springs>"),
    Quantity(f"repair_force_N.{ANY}", "tension of the suture or graft"),
    Quantity(f"tie_force_N.{ANY}", "tension of the tie from bone to bone"),
    Quantity("cable.*.tension_N", "tension of the cable *"),
    Quantity("cable.*.mean_strain_percent", "mean strain of the cable *"),
    Quantity(
        "region_strain_percent.<region>.<direction>.<percentile>",
        "<direction> strain of <region>, <percentile>",
    ),
    Quantity("region_force_N.<region>", "force that <region> transmits along its fibres"),
    Quantity("point_displacement_mm.*.<axis>", "displacement of the point *, <axis>"),
    Quantity("point_strain_percent.*.<component>", "<component> strain at the point *"),
    Quantity("gauge_strain_percent.*", "strain along the gauge *"),
    Quantity(
        "grid_strain_percent.*.<direction>.<statistic>",
        "<direction> strain of the grid *, <statistic>",
    ),
    Quantity("tension_field_area_percent.<tension>", "part of the sheet that is <tension>"),
    Quantity("max_penetration_mm", "deepest penetration of the hood into a bone"),
    Quantity("max_compression_mm", "deepest compression of the tissue between hood and bone"),
    Quantity("layer_used_up", "largest compression of that tissue over its thickness"),
    Quantity("guide_depth_mm", "tendons' lines under the bone"),
    Quantity("friction_beyond_cone", "friction beyond its coefficient times the normal force"),
    Quantity("friction_work_made", "work that friction made in place of taking it, relative"),
    Quantity("hood_unstable_modes", "ways in which the hood is unstable"),
)
"""What a summary says of an equilibrium, loaded or `unloaded`, or of the end of a motion."""
CHANGES = (
    *("posture_deg", "fingertip_force_N", "fingertip_force_in_phalanx_N", "fingertip_magnitude_N"),
    *("slip_force_N", "strain_percent", "point_displacement_mm", "point_strain_percent"),
    *("gauge_strain_percent", "grid_strain_percent"),
)
"""Quantities of a state of which a summary also says the loaded less the unloaded."""
DIFFERENCE = (
    *(q for q in STATE if q.path.split(".")[0] in CHANGES),
    Quantity(
        "engineering_strain_percent.<direction>.<percentile>",
        "<direction> engineering strain, central region, <percentile>",
    ),
    Quantity(
        "engineering_strain_percent.<direction>.<extreme>",
        "<direction> engineering strain, central region, <extreme> of the gauges at the markers",
    ),
    Quantity(
        "region_engineering_strain_percent.<region>.<direction>.<percentile>",
        "<direction> engineering strain of <region>, <percentile>",
    ),
    Quantity(
        "marker_strain_percent.<direction>.<statistic>",
        "<direction> engineering strain between markers, <statistic>",
    ),
    Quantity(
        "moment_arm_mm.<tendon>.<joint>",
        "torque of the hood about <joint> over the tension of <tendon>",
    ),
    Quantity("arm_difference_mm.<pair>", "difference of the moment arms at <pair>"),
    Quantity("abduction_arm_mm", "abduction arm at the MCP"),
)
"""What a summary says of the loaded less the unloaded equilibrium."""
ENERGIES = {
    "tendons": "work of the hood's tendons",
    "own_tendons": "work of the finger's own tendons",
    "gravity": "work of gravity",
    "kinetic": "gained as motion",
    "finger": "gained by the finger",
    "hood_stored": "stored in the hood, of one that relaxes for good",
    "hood_relaxed": "lost or still held by what relaxes in the hood",
    "joints_stored": "stored in passive joints",
    "device_stored": "stored in the fingertip's device",
    "joints_dissipated": "dissipated in the joints, of such that relax with what they still hold",
    "device_dissipated": "dissipated in the fingertip's device",
    "guides_dissipated": "lost to friction at the tendons' guides",
    "guides_held": "held at the tendons' guides before they slide",
    "gave_way": "lost where parts of the hood gave way",
    "splints": "lost where splints were put on and taken off",
    "artificial": "taken by the method",
}
"""Where the work of tendons and gravity went in a motion."""
CHECKS = {
    "audit.hood_force_balance": "forces on the hood that do not add up, relative",
    "audit.hood_moment_balance": "moments on the hood that do not add up, relative",
    "audit.finger_residual": "joint torques that do not add up, relative",
    "audit.interface_residual": "disagreement of hood and finger, relative",
    "audit.reciprocity": "tangents of load and excursion that differ, relative",
    "audit.tip_force_over_reach": "fingertip force over what the tendons can make",
    "audit.unstable_modes_bones_free": "ways in which hood and finger together are unstable",
    "audit.second_start_force_N": "difference of the fingertip force from a second start",
    "audit.second_start_angle_deg": "largest difference of a joint angle from a second start",
    "audit.torque_balance_at_rest": "torque of inertia at rest, relative",
    "audit.artificial_energy_over_effort": "energy that the method took or gave, relative",
    "audit.energy_put_in_over_effort": "energy that the method gave, relative",
    "audit.last_turn_rad": "last turn of a finger in an FMU",
    "iterations.coupling": "rounds of the coupling",
    "iterations.newton": "Newton's steps of the hood",
    "iterations.steps": "time steps",
    "iterations.hood_solves": "solves of the hood",
    "step_control.accepted": "time steps that were accepted",
    "step_control.rejected": "time steps that were rejected",
    "step_control.largest_error_deg": "largest error of an accepted step",
    "step_control.shortest_half_ms": "shortest half step",
    "step_control.longest_half_ms": "longest half step",
}
"""Figures of the audit and counts, by path."""
EVENT = {
    "time_s": "time",
    "last_time_s": "last time, of a part that peels",
    "force_N": "force",
    "stretch_mm": "stretch",
    "freed_mJ": "energy that it had stored",
    "lost_mJ": "energy that the hood lost",
    "places": "places, of a part that peels",
    "places_gone": "places that were let go",
    "at_once_with_others": "how many others, the order not told",
}
STRENGTH = {
    "share": "what it bears over what it can",
    "force_N": "force",
    "stretch_mm": "stretch",
    "energy_mJ": "energy stored",
}
HELD = {
    "fingertip_force_N.<axis>": "fingertip force, <axis>",
    "fingertip_magnitude_N": "fingertip force, magnitude",
    "tension_N.<tendon>": "tension of <tendon>",
    "slip_force_N.<slip>": "force in the <slip> slip",
    f"repair_stretch_mm.{ANY}": "how much longer than at rest * is where it is most so",
}
BETWEEN = "of friction, loading to unloading"
OF_RUN = (
    *(Quantity(f"second_start.{q.path}", f"{q.meaning}, from a second start") for q in STATE),
    *(
        Quantity(f"second_start.difference.{q.path}", f"{q.meaning}, second start less the first")
        for q in STATE
    ),
    Quantity("second_start.hood_energy_mJ.<start>", "energy stored in the hood, <start> start"),
    Quantity(
        "second_start.potential_change_mJ", "total potential of a second start less the first's"
    ),
    *(
        Quantity(f"half_degree.<turned>.{path}", f"change of {what} by half a degree of <turned>")
        for path, what in (
            ("fingertip_force_N.<axis>", "the fingertip force, <axis>,"),
            ("slip_force_N.<slip>", "the force in the <slip> slip"),
            (HOOD_TORQUE, "the hood's torque about <joint>"),
        )
    ),
    Quantity("friction.half_interval_N", f"half of the fingertip force's interval {BETWEEN}", True),
    Quantity("friction.tendon.<tendon>.coefficient", "friction of <tendon> at its guides"),
    Quantity("friction.tendon.<tendon>.turn_deg", "angle by which <tendon> turns at its guides"),
    Quantity("friction.tendon.<tendon>.tension_at_insertion_N", "tension of <tendon> at its end"),
    Quantity(
        "friction.sliding.<sliding>.fingertip_force_N.<axis>", "fingertip force, <axis>, <sliding>"
    ),
    Quantity(
        "friction.sliding.<sliding>.fingertip_magnitude_N", "fingertip force, magnitude, <sliding>"
    ),
    Quantity("friction.sliding.<sliding>.posture_deg.<joint>", "<joint> angle, <sliding>"),
    Quantity(
        "friction.sliding.<sliding>.joint_torque_Nmm.<tendon>.<joint>",
        "torque of <tendon> about <joint>, <sliding>",
    ),
    *(Quantity(f"gave_way.{ANY}.{key}", f"* gave way: {what}") for key, what in EVENT.items()),
    Quantity(f"began.{ANY}.time_s", "time at which * began to act"),
    Quantity(f"taken_off.{ANY}.time_s", "time at which * was taken off"),
    Quantity(f"taken_off.{ANY}.torque_Nmm", "*: torque under which it was taken off", True),
    Quantity(f"taken_off.{ANY}.lost_mJ", "*: energy lost then"),
    *(Quantity(f"strength.{ANY}.{key}", f"*: {what}") for key, what in STRENGTH.items()),
    Quantity("first_to_give_way.at_times_the_loads", "loads at which a part gives way first"),
    Quantity("held.time_s", "time under load, in which parts relaxed"),
    *(Quantity(f"held.at_once.{path}", f"{what}, at once") for path, what in HELD.items()),
    Quantity(
        f"held.repair_stretch_mm.{ANY}", "how much longer than at rest * is where it is most so"
    ),
    Quantity("wall_s", "wall time"),
    Quantity("hood_quads", "quads of the hood's mesh"),
    Quantity("hood_cells", "line cells of the hood"),
    Quantity("joints_at_limit.<joint>.first_s", "when <joint> first came to its limit"),
    Quantity("last_rate_rad_per_s", "largest joint rate at the end of a motion"),
    Quantity("last_force_change_N", "largest change of the fingertip force at a motion's end"),
    Quantity("largest_interface_residual", "largest disagreement of hood and finger, relative"),
    Quantity("prescribed_excursion_mm.<tendon>", "prescribed excursion of <tendon>"),
    Quantity("motor.<tendon>.drawn_mm", "how far the motor has drawn the end of <tendon>"),
    Quantity("motor.<tendon>.torque_Nmm", "torque of the motor of <tendon>"),
    Quantity("air.<tendon>.command_V", "voltage of the valve of <tendon>"),
    Quantity("air.<tendon>.pressure_kPa", "pressure in the cylinder of <tendon>"),
    Quantity("muscle.<tendon>.activation", "activation of <tendon>"),
    Quantity(
        "muscle.<tendon>.normalised_fibre_length", "fibre length of <tendon> over its optimum"
    ),
    Quantity(
        "muscle.<tendon>.assumed_normalised_fibre_length_unloaded",
        "fibre length of <tendon> over its optimum, assumed when unloaded",
    ),
    Quantity("muscle.<tendon>.pennation_deg", "pennation of <tendon>"),
    *(
        Quantity(f"energy_mJ.{name}", f"energy: {meaning}", True)
        for name, meaning in ENERGIES.items()
    ),
    *(Quantity(path, meaning) for path, meaning in CHECKS.items()),
    Quantity("rest.fingertip_force_N.<beside>", "fingertip force beside its rest: <beside>"),
    Quantity("rest.hood_torque_Nmm.<beside>", "torque of the hood beside its rest: <beside>"),
    Quantity("rest.slip_force_N.<beside>", "slip force beside its rest: <beside>"),
    Quantity("one_way.interface_residual", "interface residual that one pass leaves open"),
    Quantity(
        "one_way.handed_over_force_balance", "forces handed over that do not add up, relative"
    ),
    Quantity(
        "one_way.handed_over_moment_balance", "moments handed over that do not add up, relative"
    ),
    Quantity("one_way.joint_torque_Nmm.*.<joint>", "torque of * about <joint> in one pass"),
)
QUANTITIES = (
    *STATE,
    *(Quantity(f"unloaded.{q.path}", f"{q.meaning}, unloaded") for q in STATE),
    *(Quantity(f"difference.{q.path}", f"{q.meaning}, loaded less unloaded") for q in DIFFERENCE),
    *OF_RUN,
)
"""Every number that a summary may have: `cosim list quantities` shows them."""
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
        check_quantity(target.quantity, summaries, f"{target.called}: ")


def check_quantity(quantity: str, summaries: Summaries, place: str = "") -> None:
    """`check_quantities` of one.  Raises InputError."""
    if summaries and (fault := _fault(quantity.split("."), summaries)):
        raise InputError(f"{place}quantity {quantity}: {fault}")


def key_quantities(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Label and path of what one asks for first, of what the summary has; torques of a hood that
    makes none are left out, and of regions all but the most strained."""
    numbers = numbers_of(summary)
    for quantity in (q for q in QUANTITIES if q.is_asked_first):
        paths = [path for path in numbers if _fits(quantity, path, [summary])]
        if quantity.path == FIBRE_STRAIN:
            paths = sorted(paths, key=numbers.__getitem__, reverse=True)[:MOST_STRAINED]
        if quantity.path != HOOD_TORQUE or any(numbers[path] for path in paths):
            yield from ((_fill(quantity, path), path) for path in paths)


STRAINS_BETWEEN_POINTS = ("marker_strain_percent", "grid_strain_percent", "gauge_strain_percent")
"""Changes of distances between points, which are strains at any mesh."""


def first_numbers(summary: Mapping[str, Any], resting_tension: float) -> Iterator[tuple[str, str]]:
    """Label and path of what one asks for first, of the arms of the tendons that are pulled by more
    than the resting tension (N), and of the strains between markers and the user's points; without
    a motion's energies."""
    for label, path in key_quantities(summary):
        if path.partition(".")[0] != "energy_mJ":
            yield label, path
    pulls = summary.get("tension_N", {}).items()
    pulled = [tendon for tendon, pull in pulls if pull > resting_tension]
    arms = tuple(f"moment_arm_mm.{tendon}." for tendon in pulled)
    for path in numbers_of(summary):
        if path.startswith(arms):
            yield meaning_of(path, summary), path
        elif path.startswith(tuple(f"difference.{s}." for s in STRAINS_BETWEEN_POINTS)):
            yield meaning_of(path, summary).removesuffix(", loaded less unloaded"), path


def meaning_of(path: str, summary: Mapping[str, Any]) -> str:
    """What the number at a path of a summary is, in words; empty where no table says it."""
    fitting = (_fill(q, path) for q in QUANTITIES if _fits(q, path, [summary]))
    return next(fitting, "")


TEXTS, SWITCHES = ("audit_missed", "warnings", "double_counted"), ("converged", "came_to_rest")
"""What of a summary are lists of texts, and what is true or false."""


def misfit(summary: Mapping[str, Any]) -> str:
    """What in a summary is not of the kind that runs write there; empty where nothing is.

    >>> misfit({"case": "a", "tension_N": {"EDC": 3.0}}), misfit({"case": "a", "tension_N": 3.0})
    ('', 'tension_N is no table')
    """
    if not isinstance(summary.get("case"), str):
        return "case is no text"
    for key in (key for key in TEXTS if key in summary):
        if not isinstance(summary[key], list) or not all(isinstance(t, str) for t in summary[key]):
            return f"{key} is no list of texts"
    reasons = summary.get("audit_not_judged", {})
    if not isinstance(reasons, Mapping) or not all(isinstance(t, str) for t in reasons.values()):
        return "audit_not_judged is no table of texts"
    for key in (key for key in SWITCHES if key in summary):
        if not isinstance(summary[key], bool):
            return f"{key} is neither true nor false"
    paths = (*(quantity.path for quantity in QUANTITIES), f"audit.{ANY}", f"iterations.{ANY}")
    faults = (_misfit(summary, path.split("."), ()) for path in dict.fromkeys(paths))
    return next(filter(None, faults), "")


def _misfit(value: Any, pattern: Keys, above: Keys) -> str:
    """What is no table or no number at the paths of a pattern from a value on."""
    if not pattern:
        return "" if _is_number(value) else f"{'.'.join(above)} is no number"
    if not isinstance(value, Mapping):
        return f"{'.'.join(above)} is no table"
    first, *rest = pattern
    keys = value if first == ANY or first in NAMES else [first]
    faults = (_misfit(value[key], rest, (*above, key)) for key in keys if key in value)
    return next(filter(None, faults), "")


def _fill(quantity: Quantity, path: str) -> str:
    """The meaning, with the keys of the path in the places of what stands for them."""
    meaning = quantity.meaning
    for part, key in zip(quantity.path.split("."), path.split("."), strict=True):
        if part in NAMES or part == ANY:
            meaning = meaning.replace(part, key.replace("_", " "))
    return meaning


def is_known(quantity: str, summaries: Summaries = ()) -> bool:
    """Whether one of these runs has a number there, or null, or another run can have one."""
    keys = quantity.split(".")
    return any(_is_number(_at(summary, keys)) for summary in summaries) or any(
        _fits(known, quantity, summaries) for known in QUANTITIES
    )


def _fits(quantity: Quantity, path: str, summaries: Summaries) -> bool:
    """Whether the quantity has numbers at the path."""
    pattern, keys = quantity.path.split("."), path.split(".")
    return len(pattern) == len(keys) and _begins(pattern, keys, summaries)


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
            present = _present(above, summaries)
            near = nearest_names(key, present, share=0.34)
            near = near or nearest_names(key, names, share=1.0)
            nearest = ".".join([*above, near[0], *keys[i + 1 :]])
            listed = _list_quantities(present or names)
            return f'no "{key}" {place}; did you mean {nearest}? There are {listed}'
    inner = _names(keys, "", summaries)
    return "that is no number" + (f"; it has the parts {_list_quantities(inner)}" if inner else "")


def _names(above: Keys, key: str, summaries: Summaries) -> list[str]:
    """The names that can follow a path, those of the runs first; where a case may choose them and
    these runs have none, `key` is one."""
    present = _present(above, summaries)
    known = [*present]
    for pattern in (quantity.path.split(".") for quantity in QUANTITIES):
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
    joints = _present(["posture_deg"], summaries) if part in ("<joint>", "<turned>") else ()
    return (*NAMES.get(part, (part,)), *joints)


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
