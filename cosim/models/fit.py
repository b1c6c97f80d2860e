"""Whether the parts of a case go together: finger, hood, tendons, fingertip, motion, coupling."""

from __future__ import annotations

from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fingers.kinds import native_tendons, tip_support_kind, with_mass
from cosim.hoods.give_way import check_parts
from cosim.hoods.kinds import fitting_kinds
from cosim.models.double_count import pairs_of_case, refuse
from cosim.tendons.air import check_air
from cosim.tendons.motor import check_motors
from cosim.tendons.signals import factor_of
from meshes.skeleton import BODIES


def check_fit(case: Case) -> None:
    """Check that a case's parts go together and that its signals' files are tables.  Raises
    InputError."""
    finger, hood = case.finger.kind, case.hood.kind
    if finger not in case.hood.fits:
        words = " or ".join(f'"{kind}"' for kind in fitting_kinds(finger))
        raise InputError(
            f'hood.kind = "{hood}" does not go with finger.kind = "{finger}", which takes {words}'
        )
    if case.forward is not None and not case.finger.has_mass:
        raise InputError(f"forward takes a finger with mass: {with_mass()}")
    signals = [name for name, tendon in case.tendons.items() if tendon.signal is not None]
    if case.forward is None and signals:
        raise InputError(
            f"tendons.{signals[0]}.signal: a signal over time belongs to a motion; add a table "
            "[forward], or leave it out"
        )
    for name in signals:
        factor_of(case.tendons[name].signal)
    check_air(case.tendons, in_motion=case.forward is not None)
    check_motors(case.tendons, in_motion=case.forward is not None)
    case.finger.check_extensor(case.hood.left_to_finger)
    _check_excursions(case)
    _check_tip(case)
    _check_unit(case)
    _check_parts(case)
    _check_scheme(case)
    native = native_tendons(case.finger, case.hood.left_to_finger)
    hooded = case.hood.tendon_names(finger)
    refuse(case, pairs_of_case(case, native))
    if hooded is not None:
        check_tendons(case, hooded + native)
    _check_friction(case, native)


def _check_friction(case: Case, native: tuple[str, ...]) -> None:
    """Friction acts along the paths of tendons of a finger of ours."""
    for name in case.rubbing_tendons():
        where = f"tendons.{name}.friction"
        if not case.finger.is_native:
            raise InputError(
                f"{where}: a finger in an FMU keeps its tendons' paths to itself; leave it out, or "
                "take a finger of ours"
            )
        if name not in native:
            whose = f"runs in the hood ({case.hood.title}), whose own friction is its contact's"
            own = f"the finger's own are {', '.join(native)}" if native else "the finger has none"
            raise InputError(
                f"{where}: acts along tendons of the finger's own; {name} {whose}. Leave it out: "
                f"{own}"
            )
        if name in getattr(case.finger, "pulleys", {}):
            other = ", or lead it through points (finger.points) alone"
            raise InputError(
                f"{where}: {name} is wound on pulleys that turn (finger.pulleys), on which it does "
                f"not slide; leave it out{other if hasattr(case.finger, 'points') else ''}"
            )


def _check_excursions(case: Case) -> None:
    """Where tendons' ends may be displaced."""
    drawn = [name for name, tendon in case.tendons.items() if tendon.excursion is not None]
    if not drawn:
        return
    where = f"tendons.{drawn[0]}.excursion"
    if case.coupling.scheme == "one_way":
        raise InputError(
            f"{where}: needs a finger and a hood that are coupled; state a tension, or "
            "another coupling.scheme"
        )
    if case.forward is None:
        return
    if case.coupling.scheme in ("explicit", "jacobi"):
        raise InputError(
            f'{where}: with coupling.scheme = "{case.coupling.scheme}" the finger moves before the '
            'hood knows the tension: no end can be drawn; write "linear", "newton" or "implicit"'
        )
    if case.forward.adaptive is not None:
        raise InputError(f"{where}: does not go with forward.adaptive; state a tension")
    for name in drawn:
        if (first := factor_of(case.tendons[name].signal)(0.0)) != 0.0:
            raise InputError(
                f"tendons.{name}.excursion: a motion begins with the tendon's end undisplaced, and "
                f"the signal with {first:g}; give it one that begins at 0, for example "
                'signal = { kind = "points", at = [["0 s", 0.0], ["0.2 s", 1.0]] }'
            )


def _check_tip(case: Case) -> None:
    """What a finger in motion and one at rest can be held by; an FMU's holds itself."""
    tip = tip_support_kind(case.finger)
    if case.forward is None and tip in ("cage", "shell"):
        raise InputError(
            f'finger.tip.kind = "{tip}" holds a finger in motion; add a table [forward], or hold '
            'the tip at a point (kind = "point")'
        )
    if case.forward is not None and tip == "posture":
        raise InputError(
            'finger.tip.kind = "posture" holds every joint still, where nothing moves; leave out '
            "[forward], or hold the tip otherwise"
        )


def _check_unit(case: Case) -> None:
    """What a finger in an FMU cannot do at rest."""
    if case.forward is not None or case.finger.is_native:
        return
    for name, tendon in case.tendons.items():
        if tendon.muscle is not None or tendon.excursion is not None:
            raise InputError(
                f"tendons.{name}: with a finger in an FMU an equilibrium takes tensions or "
                "activations, and neither muscle nor excursion"
            )


def _check_parts(case: Case) -> None:
    """Check that some mesh of the hood has the parts that give way; what its own lacks shows once
    it is built.  Raises InputError."""
    if case.gives_way is None:
        return
    lesion, parts = case.lesion, case.hood.parts()
    known = [*getattr(case.hood, "springs", ()), *(parts.joined if parts else ())]
    if lesion is not None:
        known += [*(f"suture_{part}" for part in lesion.suture)]
        known += [*(f"graft_{name}" for name in lesion.graft)]
        known += [f"adhesion_{part}_{body}" for part in lesion.adhere for body in BODIES]
    check_parts(case.gives_way, dict.fromkeys(known))


def _check_scheme(case: Case) -> None:
    scheme, lumping = case.coupling.scheme, case.coupling.one_way.lumping
    barred = {
        "forward": case.forward is not None,
        f'hood.kind = "{case.hood.kind}"': not case.hood.is_coupled,
        f'finger.kind = "{case.finger.kind}"': not case.finger.is_native,
    }
    word = next((what for what, is_there in barred.items() if is_there), "")
    if scheme == "one_way" and word:
        raise InputError(
            f'coupling.scheme = "one_way" is one pass from a hood at rest to a finger; it does not '
            f"go with {word}"
        )
    if case.forward is None and scheme in ("explicit", "jacobi"):
        raise InputError(
            f'coupling.scheme = "{scheme}" takes steps in time; add a table [forward], or write '
            '"newton", "implicit" or "one_way"'
        )
    if lumping == "centre_of_mass" and not case.finger.has_mass:
        raise InputError(
            'coupling.one_way.lumping = "centre_of_mass": finger.kind = '
            f'"{case.finger.kind}" has no mass; take another finger, or lumping = "bodies"'
        )


def check_tendons(case: Case, known: tuple[str, ...]) -> None:
    """Check that every tendon that the case pulls is among `known`.  Raises InputError."""
    for name, tendon in case.tendons.items():
        if name not in known and (
            (tendon.force, tendon.excursion, tendon.signal, tendon.actuation, tendon.friction)
            != (None, None, None, None, None)
        ):
            raise InputError(
                f"tendons.{name}: this finger and hood have no such tendon; they have "
                f"{', '.join(known)}"
            )
