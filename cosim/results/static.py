"""From two equilibria to a result: the summary, the arrays, the ledger and the scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cosim.case.file import resolved_toml
from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium, coupled_stiffness
from cosim.fingers.kinds import joint_ranges
from cosim.fmu.quantity import OPEN
from cosim.hoods.view import HoodView
from cosim.models.build import Models
from cosim.models.double_count import pairs
from cosim.port import AXES, Array, Finger
from cosim.results.arrays import Arrays, along
from cosim.results.audit import HOOD_BALANCES, NOT_RECIPROCAL, PATH_DEPENDENT, missed_bounds
from cosim.results.conventions import attributes, by_axis, by_name, is_slack, vector_of
from cosim.results.give_way import strength_block
from cosim.results.half_degree import half_degree
from cosim.results.joint_limits import Limits, is_in_range, joints_at_limit, limits_of, tie_block
from cosim.results.load_and_rest import rest_block, rest_warnings
from cosim.results.parts import (
    LedgerRow,
    force_block,
    head_block,
    joint_forces,
    ledger_rows,
    muscle_block,
    state_block,
)
from cosim.results.relaxation import held_arrays, held_block
from cosim.results.result import Result
from cosim.results.scene import scene, with_measures
from cosim.results.second_start import second_start_block, second_start_differences
from cosim.results.tip_reach import arm_differences, tip_force_over_reach
from cosim.solve.held import Held
from cosim.solve.static import States
from cosim.tendons.friction import beyond_guides
from meshes.skeleton import BODIES

Books = Mapping[str, Array]
"""(nb, 6) wrenches on the bodies by source, as of `Finger.ledger`."""
STRONG = 2.0
"""The tension before a tendon's guides over that behind them from which friction is told."""


def observe_static(case: Case, solved: tuple[Models, States], wall: float) -> Result:
    """Everything that the two equilibria of a case leave behind."""
    models, states = solved
    pair, each = {"unloaded": states.unloaded, "loaded": states.loaded}, states.models_at(models)
    every = {n: m.built.view_of(pair[n].response.state) for n, m in each.items()}
    views = {n: view for n, view in every.items() if view is not None}
    books = {
        name: each[name].finger.ledger(e.finger_state, e.load, e.finger_tension)
        for name, e in pair.items()
    }
    values = arrays(case, models, pair, views, states.held)
    shown = scene(models, states.loaded, views.get("loaded"))
    return Result(
        summary(case, models, states, views, books, wall),
        values,
        tuple(row for name, e in pair.items() for row in ledger(name, e, books[name])),
        with_measures(shown, values, -1, case),
        resolved_toml(case),
        case.name,
    )


def summary(
    case: Case,
    models: Models,
    states: States,
    views: Mapping[str, HoodView],
    books: Mapping[str, Books],
    wall: float,
) -> dict[str, Any]:
    """The numbers one asks for first; every key ends in its unit."""
    loaded, unloaded = states.loaded, states.unloaded
    head = head_block(case, True, wall)
    if views:
        head |= views["loaded"].size()
    limits = {} if loaded.balance is None else limits_of(case, joint_ranges(models.finger))
    resting = states.models_at(models)["unloaded"]
    at_rest = _state(resting, unloaded, books["unloaded"], views.get("unloaded"), limits)
    at_load = _state(models, loaded, books["loaded"], views.get("loaded"), limits)

    def describe(e: Equilibrium) -> dict[str, Any]:
        book = models.finger.ledger(e.finger_state, e.load, e.finger_tension)
        return _state(models, e, book, models.built.view_of(e.response.state), limits)

    passed = states.one_way
    load, motion = (loaded.load, loaded.motion) if passed is None else (passed.answer, passed.at)
    audit = by_name(HOOD_BALANCES, load.imbalance(motion))
    if loaded.balance is None:
        audit["last_turn_rad"] = loaded.turn
    else:
        audit["finger_residual"] = loaded.finger_residual
        if passed is None:
            audit["interface_residual"] = loaded.interface_residual
    if states.reciprocity is not None:
        audit["reciprocity"] = states.reciprocity
    not_judged = {"reciprocity": NOT_RECIPROCAL} if case.hood.has_friction else {}
    over_reach = tip_force_over_reach(case, models, states)
    match over_reach:
        case str():
            not_judged["tip_force_over_reach"] = over_reach
        case _:
            audit["tip_force_over_reach"] = over_reach
    if loaded.balance is not None:
        stiffness = coupled_stiffness(models.finger, loaded)
        audit["unstable_modes_bones_free"] = int((stiffness < 0).sum())
    if states.second is not None:
        if reason := PATH_DEPENDENT if case.hood.has_friction else states.second.failure:
            not_judged["second_start"] = reason
        else:
            audit |= second_start_differences(models, states)
    missed = missed_bounds(
        {**at_load, "audit": audit},
        posture_in_range=loaded.balance is None or _is_in_range(models, loaded),
    )
    lengths = dict(zip(models.muscles.names, states.pull.normalised_length, strict=True))
    newton = views["loaded"].iterations if "loaded" in views else 0
    iterations = {"coupling": loaded.iterations, "newton": newton}
    rest = rest_block(at_load, at_rest, models.hood.tendons)
    friction = _friction(case, models, states)
    beside = {
        "unloaded": at_rest,
        "rest": rest,
        "warnings": [
            *rest_warnings(rest, at_rest, is_laid=case.hood.lies_on_bones),
            *_strong_friction(friction),
            *models.warnings,
        ],
        "difference": _difference(models, unloaded, loaded, at_rest, at_load, views)
        | _clamped_arms(case, models, unloaded, loaded),
        "audit": audit,
        "audit_missed": missed,
        **({"audit_not_judged": not_judged} if not_judged else {}),
        **({"not_in_ledger": OPEN} if loaded.balance is None else {}),
        **muscle_block(case, lengths, states.pull.pennation),
        **strength_block(states.strength),
        **held_block(states.held, (*models.hood.tendons, *models.finger.tendons)),
        **_one_way(case, models, states),
        **second_start_block(models, states, at_load, describe),
        **friction,
        **half_degree(case, models, states),
        "iterations": iterations,
    }
    return {**head, **at_load, **beside}


def _friction(case: Case, models: Models, states: States) -> dict[str, Any]:
    """How tendons with friction turn and what is left at their insertions; and what there is with
    all of them loading, and all unloading."""
    if not (rubbing := case.rubbing_tendons()):
        return {}
    e = states.loaded
    left = beyond_guides(models.finger, e.finger_state, e.finger_tension)
    tendons = {
        name: {
            "coefficient": tendon.friction,
            "turn_deg": float(np.rad2deg(left[name][1])),
            "tension_at_insertion_N": left[name][0],
        }
        for name, tendon in rubbing.items()
    }
    ways: dict[str, Any] = {}
    forces = []
    for sliding, on in states.ways.items():
        if on.found is None:
            ways[sliding] = {"failure": on.failure}
            continue
        force = on.finger.tip_force(on.found.finger_state)
        forces.append(force)
        torque = on.found.known_balance.torque
        ways[sliding] = {
            **force_block(force),
            "posture_deg": _by_joint(models, np.rad2deg(on.finger.angles(on.found.finger_state))),
            "joint_torque_Nmm": {name: _by_joint(models, 1e3 * torque[name]) for name in rubbing},
        }
    out: dict[str, Any] = {"tendon": tendons, "sliding": ways}
    if len(forces) == 2:
        out["half_interval_N"] = float(0.5 * np.linalg.norm(forces[1] - forces[0]))
    return {"friction": out}


def _strong_friction(friction: Mapping[str, Any]) -> list[str]:
    """In words the tendons on which friction takes or adds more than the muscle pulls with."""
    tendons = friction.get("friction", {}).get("tendon", {})
    factors = {t: np.exp(f["coefficient"] * np.radians(f["turn_deg"])) for t, f in tendons.items()}
    return [
        f"{t}: friction of {tendons[t]['coefficient']:g} over {tendons[t]['turn_deg']:.0f} deg of "
        f"turn makes the tension at its end 1/{factor:.3g} of its muscle's while it slides there, "
        f"and {factor:.3g} times as much while it slides back"
        for t, factor in factors.items()
        if factor > STRONG
    ]


def _is_in_range(models: Models, e: Equilibrium) -> bool:
    finger = models.finger
    return is_in_range(finger.joints, finger.angles(e.finger_state), joint_ranges(finger))


def _one_way(case: Case, models: Models, states: States) -> dict[str, Any]:
    """What a one-way pass handed over, and what is counted twice in it."""
    counted = pairs(case, models.hood, models.finger)
    out: dict[str, Any] = {"double_counted": [str(pair) for pair in counted]} if counted else {}
    if states.one_way is not None:
        force, moment = states.loaded.load.imbalance(states.loaded.motion)
        out["one_way"] = {
            **case.coupling.one_way.model_dump(),
            "interface_residual": states.one_way.interface_residual,
            "handed_over_force_balance": force,
            "handed_over_moment_balance": moment,
            "joint_torque_Nmm": {
                source: _by_joint(models, 1e3 * torque)
                for source, torque in states.one_way.torque.items()
            },
        }
    return out


def _state(
    models: Models, e: Equilibrium, books: Books, view: HoodView | None, limits: Limits
) -> dict[str, Any]:
    """One equilibrium in numbers."""
    hood, finger = models.hood, models.finger
    on_world = finger.tip_force(e.finger_state)
    angles, tension = finger.angles(e.finger_state), np.append(e.hood_tension, e.finger_tension)
    in_phalanx = e.motion.rotation[-1].T @ on_world
    out = state_block(finger, hood, angles, tension, e.excursion, on_world, in_phalanx)
    if e.balance is not None:
        out["fingertip_moment_Nmm"] = by_axis(1e3 * _tip_moment(models, e, books))
        out["joint_force_N"] = _joint_forces(models, e, books)
    arms = _arms(models, e)
    if arms or e.balance is not None:
        out["moment_arm_mm"] = {t: _by_joint(models, 1e3 * arm) for t, arm in arms.items()}
    if e.balance is not None and finger.tendons:
        straight, now = (finger.path_lengths(at) for at in (finger.start({}), e.finger_state))
        out["own_excursion_mm"] = by_name(finger.tendons, 1e3 * (straight - now))
    if e.balance is not None:
        out["joint_torque_Nmm"] = {
            source: _by_joint(models, 1e3 * torque) for source, torque in e.balance.torque.items()
        }
        borne = e.balance.torque.get("limit", np.zeros(len(finger.joints)))
        at = _by_joint(models, angles), _by_joint(models, borne)
        if at_limit := joints_at_limit(limits, *at):
            out["joints_at_limit"] = at_limit
    out |= tie_block(finger, finger.angles(e.finger_state))
    if slips := models.slips_of(e):
        out["slip_force_N"] = dict(slips)
        if not is_slack(slips, "central"):
            out["slip_ratio"] = slips["terminal"] / slips["central"]
    return out if view is None else {**out, **view.summary()}


def _joint_forces(models: Models, e: Equilibrium, books: Books) -> dict[str, dict[str, float]]:
    if "joint" not in books:
        return {}
    return joint_forces(books["joint"], e.load.bodies, models.finger.joints)


def _tip_moment(models: Models, e: Equilibrium, books: Books) -> Array:
    """The moment (3,) N m of the tip on the world about the fingertip, zero where it is free to
    turn."""
    held = books["fingertip"][-1]
    lever = models.finger.tip(e.finger_state) - e.motion.position[-1]
    moment: Array = np.cross(lever, held[:3]) - held[3:]
    return moment


def _arms(models: Models, e: Equilibrium) -> dict[str, Array]:
    """Moment arms (nq,) m of each tendon: d tau/d T for those of the hood, tau/T for the finger's
    own, as far as the finger reports them."""
    by_force = _arms_by_force(models, e)
    out = {} if by_force is None else dict(zip(models.hood.tendons, by_force.T, strict=True))
    if e.balance is None:
        return out
    for tendon, tension in zip(models.finger.tendons, e.finger_tension, strict=True):
        if tension > 0:
            out[tendon] = e.balance.torque[tendon] / tension
    return out


def _arms_by_force(models: Models, e: Equilibrium) -> Array | None:
    """Moment arms (nq, nt) m of the hood's tendons, where the finger says how its bodies turn."""
    finger: Finger = models.finger
    jacobian = finger.jacobian(e.finger_state)
    return None if jacobian is None else jacobian.T @ e.jacobian.load_tension


def _difference(
    models: Models,
    unloaded: Equilibrium,
    loaded: Equilibrium,
    rest: Mapping[str, Any],
    at_load: Mapping[str, Any],
    views: Mapping[str, HoodView],
) -> dict[str, Any]:
    """Loaded less unloaded: forces, joint angles, strains, and per tendon that was pulled its
    effective moment arms, change of the hood's joint torques over change of tension."""

    def change(key: str) -> Array:
        return vector_of(at_load[key]) - vector_of(rest[key])

    out: dict[str, Any] = {
        **force_block(change("fingertip_force_N"), change("fingertip_force_in_phalanx_N")),
        "posture_deg": {j: at_load["posture_deg"][j] - a for j, a in rest["posture_deg"].items()},
    }
    if "slip_force_N" in at_load:
        slips = at_load["slip_force_N"]
        out["slip_force_N"] = {k: slips[k] - rest["slip_force_N"][k] for k in slips}
    first, last = views.get("unloaded"), views.get("loaded")
    if first is not None and last is not None:
        out |= last.change(first)
    pull = loaded.hood_tension - unloaded.hood_tension
    pulled = np.flatnonzero(pull)
    if len(pulled) == 1 and loaded.balance is not None:
        torque = 1e3 * (loaded.known_balance.torque["hood"] - unloaded.known_balance.torque["hood"])
        i = int(pulled[0])
        out["moment_arm_mm"] = {models.hood.tendons[i]: _by_joint(models, torque / pull[i])}
    return out


def _clamped_arms(
    case: Case, models: Models, unloaded: Equilibrium, loaded: Equilibrium
) -> dict[str, Any]:
    """What a clamped fingertip says of the arms of the tendons whose tensions rise."""
    finger = models.finger
    rise = np.concatenate(
        [
            loaded.hood_tension - unloaded.hood_tension,
            loaded.finger_tension - unloaded.finger_tension,
        ]
    )
    held = loaded.balance is not None and case.native_finger().tip.kind == "clamped"
    if not held or loaded.motion.bodies != BODIES or rise.min() < 0 or not rise.any():
        return {}
    first, last = unloaded.finger_state, loaded.finger_state
    points = np.vstack([loaded.motion.position[1:], finger.tip(last)])
    force = finger.tip_force(last) - finger.tip_force(first)
    return arm_differences(points, force, float(rise.sum()))


def _by_joint(models: Models, values: Array) -> dict[str, float]:
    return by_name(models.finger.joints, values)


def ledger(name: str, e: Equilibrium, books: Books) -> Iterator[LedgerRow]:
    """A row per body and source; those of one body add up to zero."""
    hood = {f"hood {s}": e.load.wrench[:, i] for i, s in enumerate(e.load.sources)}
    return ledger_rows(name, e.load.bodies, {**hood, **books})


def arrays(
    case: Case,
    models: Models,
    states: Mapping[str, Equilibrium],
    views: Mapping[str, HoodView],
    held: Held | None = None,
) -> Arrays:
    """All arrays against the load axis `state`, SI units; of a load that is held against its time
    too."""
    hood, finger, each = models.hood, models.finger, list(states.values())
    data = along(
        "state",
        {
            "angle": [finger.angles(e.finger_state) for e in each],
            "position": [e.motion.position for e in each],
            "rotation": [e.motion.rotation for e in each],
            "tension": [e.hood_tension for e in each],
            "own_tension": [e.finger_tension for e in each],
            "excursion": [e.excursion for e in each],
            "hood_force": [e.load.wrench[..., :3] for e in each],
            "hood_moment": [e.load.wrench[..., 3:] for e in each],
            "pull_force": [e.load.pull[:, :3] for e in each],
            "pull_moment": [e.load.pull[:, 3:] for e in each],
            "tip_force": [finger.tip_force(e.finger_state) for e in each],
        },
    )
    arms = [arm for e in each if (arm := _arms_by_force(models, e)) is not None]
    if arms:
        data |= along("state", {"moment_arm": arms})
    every = [[f for f in view.fields() if f.in_results] for view in views.values()]
    for each_state in zip(*every, strict=True):
        f = each_state[0]
        about = {"units": f.unit, "long_name": f.long_name}
        data[f.name] = (("state", *f.dimensions), np.stack([at.values for at in each_state]), about)
    coords: dict[str, Any] = {
        "state": list(states),
        "joint": list(finger.joints),
        "body": list(hood.bodies),
        "axis": list(AXES),
        "body_axis": list(AXES),
        "tendon": list(hood.tendons),
        "muscle": list(finger.tendons),
        "source": list(hood.sources),
    }
    if each[0].balance is not None:
        coords["torque_source"] = list(each[0].known_balance.torque)
        data |= along("state", {"torque": [list(e.known_balance.torque.values()) for e in each]})
    for view in views.values():
        coords |= view.coordinates()
    over_time, times = held_arrays(held)
    data, coords = data | over_time, coords | times
    return Arrays.of(data, coords, **attributes(case.title, case.name, case.finger.side()))
