"""Whether the parts of a case go together: finger, hood, tendons, fingertip, motion, coupling."""

from __future__ import annotations

from cosim.build.double_count import refuse, stated_pairs
from cosim.case.schema import Case, held_by
from cosim.fingers.fmu import FmuFinger
from cosim.fingers.hinge import HingeFinger
from cosim.fingers.index import IndexFinger
from cosim.fingers.kinds import finger_model
from cosim.fingers.robot import RobotFinger
from cosim.hoods.cable.table import CableHood
from cosim.hoods.fmu import FmuHood
from cosim.hoods.lumped.table import NetworkHood, TwoBandHood
from cosim.hoods.pulley import PulleyHood
from cosim.hoods.shell.table import ShellHood
from cosim.hoods.split import SplitHood
from cosim.port import InputError
from cosim.tendons.air import check_air
from cosim.tendons.courses import factor_of
from meshes.skeleton import BODIES

HOODS = {
    "index": ("shell", "cable", "pulley", "split", "network", "two_band", "fmu"),
    "middle": ("shell", "pulley", "split", "network", "fmu"),
    "planar": ("pulley", "network", "two_band", "fmu"),
    "hinge": ("pulley", "network", "two_band", "fmu"),
    "robot": ("split", "cable", "pulley", "network", "two_band", "fmu"),
    "fmu": ("pulley", "fmu"),
}
"""Which hoods go on which finger."""


def check_fit(case: Case) -> None:
    """Raises InputError where a case's parts do not go together or a course's file is no table."""
    finger, hood = case.finger.kind, case.hood.kind
    if hood not in HOODS[finger]:
        words = " or ".join(f'"{kind}"' for kind in HOODS[finger])
        raise InputError(
            f'hood.kind = "{hood}" does not go with finger.kind = "{finger}", which takes {words}'
        )
    if case.forward is not None and finger == "hinge":
        raise InputError(
            'forward takes a finger with mass: finger.kind = "index", "middle", "planar" or "robot"'
        )
    courses = [name for name, tendon in case.tendons.items() if tendon.course is not None]
    if case.forward is None and courses:
        raise InputError(
            f"tendons.{courses[0]}.course: a course over time belongs to a motion; add a table "
            "[forward], or leave it out"
        )
    for name in courses:
        factor_of(case.tendons[name].course)
    check_air(case.tendons, in_motion=case.forward is not None)
    _check_pulley(case)
    _check_own(case)
    _check_drawn(case)
    _check_tip(case)
    _check_unit(case)
    _check_scheme(case)
    refuse(case, stated_pairs(case, _own_tendons(case)))
    if not isinstance(case.hood, ShellHood | CableHood):  # whose tendons its mesh has
        check_tendons(case, _hood_tendons(case) + _own_tendons(case))


def _check_pulley(case: Case) -> None:
    """What the robotic finger's own pulley leaves to say."""
    if not (isinstance(case.finger, RobotFinger) and isinstance(case.hood, SplitHood)):
        return
    from rigid.fingers.robot_tables import LONG, SHORT

    if case.hood.central != 2 * SHORT:
        raise InputError(
            f"hood.central: the robotic finger's pulley parts its extensor by {LONG:g} and twice "
            f"{SHORT:g}, and has no other shares; leave it out"
        )


def _check_own(case: Case) -> None:
    """What a finger out of the user's file leaves to say."""
    if not (isinstance(case.finger, IndexFinger) and case.finger.path is not None):
        return
    if isinstance(case.hood, SplitHood) and case.hood.central != SplitHood(kind="split").central:
        raise InputError(
            "hood.central: a finger out of a file (finger.path) parts its tendons as the file "
            "says; leave it out"
        )
    lacking = [body for body in BODIES if body not in case.finger.bones]
    if lacking and isinstance(case.hood, ShellHood | CableHood):
        raise InputError(
            f"finger.bones: a {case.hood.kind} hood lies on the bones, and our {lacking[0]} does "
            "not fit a finger out of a file (finger.path); give a surface for each of "
            f"{', '.join(lacking)}"
        )


def _check_drawn(case: Case) -> None:
    """Where tendons' ends may be displaced."""
    drawn = [name for name, tendon in case.tendons.items() if tendon.excursion is not None]
    if not drawn:
        return
    where = f"tendons.{drawn[0]}.excursion"
    if case.coupling.scheme == "one_way":
        raise InputError(
            f"{where}: belongs to a finger and a hood that are coupled; state a tension, or "
            "another coupling.scheme"
        )
    if case.forward is None:
        return
    if case.coupling.scheme in ("explicit", "jacobi"):
        raise InputError(
            f'{where}: with coupling.scheme = "{case.coupling.scheme}" the finger moves before the '
            'hood feels a tension, which then draws no end; write "linear", "newton" or "implicit"'
        )
    if case.forward.adaptive is not None:
        raise InputError(f"{where}: does not go with forward.adaptive; state a tension")
    for name in drawn:
        if (first := factor_of(case.tendons[name].course)(0.0)) != 0.0:
            raise InputError(
                f"tendons.{name}.excursion: a motion begins with the tendon's end undisplaced, and "
                f"the course with {first:g}; give it one that begins at 0, for example "
                'course = { kind = "points", at = [["0 s", 0.0], ["0.2 s", 1.0]] }'
            )


def _check_tip(case: Case) -> None:
    """What a finger in motion and one at rest can be held by; an FMU's holds itself."""
    tip = held_by(case)
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
    if case.forward is not None or case.finger.kind != "fmu":
        return
    for name, tendon in case.tendons.items():
        if tendon.muscle is not None or tendon.excursion is not None:
            raise InputError(
                f"tendons.{name}: with a finger in an FMU an equilibrium takes tensions or "
                "activations, and neither muscle nor excursion"
            )


def _check_scheme(case: Case) -> None:
    scheme, lumping = case.coupling.scheme, case.coupling.one_way.lumping
    barred = {
        "forward": case.forward is not None,
        'hood.kind = "split"': case.hood.kind == "split",
        'finger.kind = "fmu"': case.finger.kind == "fmu",
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
    if lumping == "centre_of_mass" and case.finger.kind == "hinge":
        raise InputError(
            'coupling.one_way.lumping = "centre_of_mass": finger.kind = "hinge" has no mass; take '
            'another finger, or lumping = "bodies"'
        )


def _hood_tendons(case: Case) -> tuple[str, ...]:
    if isinstance(case.hood, PulleyHood):
        return tuple(case.hood.paths)
    if isinstance(case.hood, NetworkHood | TwoBandHood):
        return tuple(case.hood.muscles)
    return case.hood.tendons if isinstance(case.hood, FmuHood) else ()


def _own_tendons(case: Case) -> tuple[str, ...]:
    finger = case.finger
    if isinstance(finger, FmuFinger):
        return finger.tendons
    return () if isinstance(finger, HingeFinger) else finger_model(finger, case.hood).muscles


def check_tendons(case: Case, known: tuple[str, ...]) -> None:
    """Raises InputError for a tendon that the case pulls and that is not among `known`."""
    for name, tendon in case.tendons.items():
        if name not in known and (
            (tendon.force, tendon.excursion, tendon.course, tendon.actuation)
            != (None, None, None, None)
        ):
            raise InputError(
                f"tendons.{name}: this finger and hood have no such tendon; they have "
                f"{', '.join(known)}"
            )
