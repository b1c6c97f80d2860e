"""The live models of a case: its finger and hood behind the port."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from cosim.case.relaxation import TISSUES, RelaxationLawConfig
from cosim.case.schema import Case, CouplingConfig
from cosim.coupling.accelerators import Accelerator, Aitken, ConstantRelaxation, QuasiNewton
from cosim.coupling.schemes import Explicit, Implicit, Linear, Newton, Scheme
from cosim.errors import InputError
from cosim.fingers.kinds import anatomy_of, bones_of, live_finger, mjcf, unit
from cosim.hoods.kind import BuiltHood, Site, Slips
from cosim.hoods.kinds import KINDS
from cosim.models.fit import check_fit, check_tendons
from cosim.port import Array, Hood, Motion, OpenFinger, Pair, PairState, Triangles
from cosim.tendons.friction import with_friction
from cosim.tendons.muscles import CaseMuscles, live_muscles
from cosim.tendons.table import Sliding
from meshes.hood_mesh import HoodMesh

if TYPE_CHECKING:
    from cosim.coupling.equilibrium import Equilibrium
    from fe_solver.materials.prony import Prony
    from rigid.mjcf.hood import HoodParts


OPEN = np.radians(90.0)
"""rad, the widest half range of a finger's limit: no joint stops before its anatomical range."""
OPENING = 'finger.limit.half_range="90 deg"'


@dataclass(frozen=True)
class Models:
    """What a case builds: a finger and a hood behind the port, and what pictures need."""

    finger: OpenFinger
    built: BuiltHood
    """The hood, and what there is to know of its states."""
    posture: Mapping[str, float]
    resting: float
    bones: Mapping[str, Triangles]
    muscles: CaseMuscles
    lines: Callable[[Motion], Mapping[str, Array]]
    """(k, 3) m each, what pictures draw of the hood as lines at some poses."""
    warnings: Sequence[str] = ()
    """What to know of the hood's mesh."""

    @property
    def hood(self) -> Hood:
        """The hood behind the port."""
        return self.built.hood

    @property
    def pair(self) -> Pair:
        """The finger and the hood on it."""
        return Pair(self.finger, self.hood)

    @property
    def is_alive(self) -> bool:
        """Whether they can be asked: not once the process of an FMU among them has ended."""
        return all(getattr(part, "is_alive", True) for part in (self.finger, self.hood))

    def slips_of(self, e: Equilibrium) -> Slips:
        """N in the slips in an equilibrium, by name; none of a hood and finger without."""
        return self.built.slip_forces(e.response.state, self.finger.tendons, e.finger_tension)

    def with_hood(self, hood: Hood) -> Models:
        """The models with another hood of the same mesh, and what there is to know of it."""
        assert self.built.around is not None
        return replace(self, built=self.built.around(hood))

    def start(self) -> PairState:
        """The finger in its posture, and the hood on it."""
        finger = self.finger.start(self.posture)
        return PairState(finger, self.hood.start(self.finger.motion(finger)))


def build(case: Case) -> Models:
    """Models of a case with a finger of ours, for what asks them without time.  Raises InputError
    for what only building finds out, and where they relax."""
    case.native_finger()
    if case.relaxation is not None:
        raise InputError(
            f"{case.name}: relaxation: parts relax in a run (`cosim run`, a study), and nothing "
            "else follows their time; leave it out here"
        )
    return build_any(case)


def build_any(case: Case, in_time: bool = False) -> Models:
    """Models of any case: a finger in an FMU is a `cosim.port.Finger` and no more, which is all
    that the solver and the observer of an equilibrium ask for; `in_time` with a hood whose parts
    give way or relax as the case says."""
    check_fit(case)
    if wrong := case.unfit_relaxation():  # of a case whose hood was replaced since it was read
        raise InputError(wrong)
    if case.finger.is_native:
        finger: OpenFinger = case_finger(case)
        posture = case.native_finger().posture.angles()
    else:
        finger, posture = cast(OpenFinger, unit(case.finger).at_rest()), {}
    site = site_of(case, finger.rest())
    hood = build_hood(case, site)
    if in_time and case.gives_way is not None:
        from cosim.hoods.giving import giving_hood

        hood = giving_hood(hood, case.gives_way)
    if in_time and (prony := relaxing(case).hood) is not None:
        from cosim.hoods.relaxing import relaxing_hood

        hood = relaxing_hood(hood, prony)
    return Models(
        finger,
        hood,
        posture,
        case.solve.resting_tension,
        site.anatomy.bones,
        live_muscles(case.tendons),
        case.hood.lines,
        mesh_warnings(case),
    )


class Relaxing(NamedTuple):
    """By which laws parts relax; None of those that do not."""

    hood: Prony | None
    tendons: Prony | None
    joints: Prony | None


def relaxing(case: Case) -> Relaxing:
    """What relaxes in a case, and by which laws."""
    stated = case.relaxation
    laws = [None if stated is None else getattr(stated, part) for part in Relaxing._fields]
    return Relaxing(*(None if law is None else _prony(law) for law in laws))


def _prony(stated: RelaxationLawConfig) -> Prony:
    from fe_solver.materials.prony import Prony

    law = stated if stated.tissue is None else TISSUES[stated.tissue]
    if law.weights is not None and law.times is not None:
        return Prony(np.array(law.weights), np.array(law.times))
    assert law.spectrum is not None
    assert law.shortest is not None
    assert law.longest is not None
    return Prony.fung(law.spectrum, law.shortest, law.longest)


def with_own_finger(models: Models, case: Case) -> Models:
    """The models of a case with another's hood, from which it differs in no more than what holds
    the fingertip (`Case.hood_key`).  Raises InputError."""
    check_fit(case)
    return replace(models, finger=case_finger(case), muscles=live_muscles(case.tendons))


def case_finger(case: Case, sliding: Sliding | None = None) -> OpenFinger:
    """The finger of ours of a case, with the friction of its own tendons, each sliding as it states
    or all one way.  Raises InputError."""
    finger = live_finger(case.native_finger(), case.hood.left_to_finger)
    return with_friction(finger, case.tendons, sliding)


def site_of(case: Case, rest: Motion) -> Site:
    """What the hood of a case is built on; `rest`: the poses from which the excursions of a hood
    that is not laid out count."""
    anatomy = anatomy_of(case.finger, case.hood.left_to_finger)
    return Site(anatomy, rest, case.lesion, case.solve.tolerances[1])


def build_hood(case: Case, site: Site) -> BuiltHood:
    """The hood of a case.  Raises InputError."""
    check_lesion(case)
    return KINDS[case.hood.kind].builder.build(case.hood, site)


def check_lesion(case: Case) -> None:
    """Check that the hood can have the case's lesion, of a case whose hood was replaced since it
    was read.  Raises InputError."""
    if wrong := case.unfit_lesion():
        raise InputError(wrong)


def tensions(case: Case, models: Models) -> tuple[Array, Array]:
    """The tensions (N) of the hood's and of the finger's own tendons, a muscle's fibre left out.
    Raises InputError for one that neither has."""
    hood, finger = models.hood.tendons, models.finger.tendons
    check_tendons(case, (*hood, *finger))
    return np.array([case.tension(t) for t in hood]), np.array([case.tension(t) for t in finger])


def hood_mesh(case: Case) -> HoodMesh:
    """The sheet of a case's hood, read or generated, before any lesion.  Raises InputError."""
    mesh = KINDS[case.hood.kind].builder.mesh
    if mesh is None:
        raise InputError(f"{case.name}: its hood ({case.hood.title}) has no mesh of quads")
    return mesh(case.hood, anatomy_of(case.native_finger(), case.hood.left_to_finger))


def mesh_warnings(case: Case) -> Sequence[str]:
    """What to know of the mesh of a case's hood.  Raises InputError."""
    if not case.hood.files():
        return ()
    anatomy = anatomy_of(case.finger, case.hood.left_to_finger)
    return KINDS[case.hood.kind].builder.mesh_warnings(case.hood, anatomy)


def mesh_advice(case: Case) -> str:
    """What to do about the mesh of a case's hood where a solve failed; nothing where it follows the
    heads of the bones.  Raises InputError."""
    anatomy = anatomy_of(case.finger, case.hood.left_to_finger)
    return KINDS[case.hood.kind].builder.mesh_advice(case.hood, anatomy)


def bone_surfaces(case: Case) -> Mapping[str, Triangles]:
    """Surfaces of the bones in their bodies' frames, m."""
    return bones_of(case.native_finger(), case.hood.left_to_finger)


PULLERS = {"pneumatic": "pneumatic cylinder", "motor": "motor"}
"""The kinds of actuation in words."""


def narrow_limits(case: Case) -> list[str]:
    """In words that the joints of a case's finger stop about the posture, where they do so before
    OPEN; else nothing."""
    limit = case.native_finger().limit
    if limit is None or limit.half_range >= OPEN:
        return []
    return [
        f"limits: the joints turn {np.degrees(limit.half_range):.3g} deg to either side of the "
        "posture, as the case's finger.limit says, and not over their anatomical range"
    ]


def mjcf_of(case: Case, hood: HoodParts | None = None) -> str:
    """The finger of a case as MJCF, with these parts of a hood, at the resting tensions.  Raises
    InputError for one that has none."""
    lost = [f"{words}; the setting {OPENING} opens them" for words in narrow_limits(case)]
    lost += [
        f"{name}: its friction of {tendon.friction:g} at guides is left out; along a tendon MuJoCo "
        "has one tension"
        for name, tendon in case.rubbing_tendons().items()
    ]
    lost += [
        f"{name}: its stretch is left out; the actuator states the tension"
        for name, tendon in case.tendons.items()
        if tendon.elastic is not None
    ]
    lost += [
        f"{name}: the {PULLERS[tendon.actuation.kind]} that pulls it is left out; the actuator "
        "states the tension"
        for name, tendon in case.tendons.items()
        if tendon.actuation is not None
    ]
    if case.relaxation is not None:
        lost.append("relaxation is left out; all is as at once")
    resting = case.solve.resting_tension
    return mjcf(case.native_finger(), case.hood.left_to_finger, resting, lost, hood)


def scheme_of(coupling: CouplingConfig) -> Scheme:
    """The scheme of a motion in time that a case states."""
    if coupling.scheme == "implicit":
        return Implicit(accelerator_of(coupling), coupling.tolerance)
    if coupling.scheme == "newton":
        return Newton(coupling.tolerance)
    if coupling.scheme == "linear":
        return Linear()
    return Explicit(parallel=coupling.scheme == "jacobi")


def accelerator_of(coupling: CouplingConfig) -> Accelerator:
    """The accelerator of the scheme "implicit" that a case states."""
    accelerators: dict[str, Accelerator] = {
        "constant": ConstantRelaxation(),
        "aitken": Aitken(),
        "iqn_ils": QuasiNewton(),
    }
    return accelerators[coupling.accelerator]
