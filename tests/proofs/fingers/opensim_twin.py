"""The finger of `tests.proofs.fingers.thesis_twin` in OpenSim: a cross-check, where the package
`opensim` is installed.

It makes the committed figures; from the repository's root, with a Python that has `opensim`:

    python -m tests.proofs.fingers.opensim_twin tests/data/opensim/twin_opensim.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from cosim.port import Array
from rigid.chain.joint_torques import JointLaw
from rigid.model import FingerModel, Segment, Via
from rigid.mujoco.tip_device import TipContact
from tests.proofs.fingers.thesis_twin import POSTURE, TENSIONS, twin_law, twin_model

ACCURACY = 1e-5
"""Relative, of Runge-Kutta-Merson."""
DURATION = 2.0
"""s (thesis, section 2.2)."""
CAGE_HALF = 0.0045
"""m, from the cage's centre to a wall (thesis: 9 mm)."""
OUTWARD = (
    ("distal", (1, 0, 0), (0, 0, 0)),
    ("proximal", (-1, 0, 0), (0, 0, 180)),
    ("radial", (0, 1, 0), (0, 0, 90)),
    ("ulnar", (0, -1, 0), (0, 0, -90)),
    ("dorsal", (0, 0, 1), (0, -90, 0)),
    ("palmar", (0, 0, -1), (0, 90, 0)),
)
"""The outward normal of each wall, and the turns (deg) that lay OpenSim's x axis along it."""


@dataclass(frozen=True)
class Settled:
    """What OpenSim ends with."""

    angles: Array
    """(nq,) rad."""
    rates: Array
    """(nq,) rad/s."""
    force: Array
    """(3,) N, of the fingertip on the world."""
    cpu: float
    """s, of the integration alone."""


class OpenSimFinger:
    """A finger model of path points in OpenSim with its coordinate limits; its tip is in a cage in
    the world's axes, or held at a point."""

    def __init__(
        self,
        finger: FingerModel,
        law: JointLaw,
        posture: Mapping[str, float],
        tension: Mapping[str, float],
        contact: TipContact | None,
    ) -> None:
        """contact: of the cage about the tip; None: its point is held."""
        import opensim

        opensim.Logger.setLevelString("Error")
        self._posture = posture
        self.model = opensim.Model()
        self.model.setGravity(opensim.Vec3(0))
        self._bodies = {finger.bodies[0]: self.model.getGround()}
        for before, segment in zip(finger.segments, finger.segments[1:], strict=False):
            self._add_segment(before, segment)
        self._add_limits(law)
        self._add_tendons(finger, tension)
        self._add_device(finger, contact)

    def settle(self, duration: float = DURATION, accuracy: float = ACCURACY) -> Settled:
        """The end of a forward simulation from the posture at rest."""
        import opensim

        state = self._start()
        manager = opensim.Manager(self.model)
        manager.setIntegratorMethod(opensim.Manager.IntegratorMethod_RungeKuttaMerson)
        manager.setIntegratorAccuracy(accuracy)
        manager.initialize(state)
        begin = process_time()
        state = manager.integrate(duration)
        cpu = process_time() - begin
        coordinates = [self.model.getCoordinateSet().get(name) for name in self._posture]
        return Settled(
            np.array([c.getValue(state) for c in coordinates]),
            np.array([c.getSpeedValue(state) for c in coordinates]),
            self._force(state),
            cpu,
        )

    def _start(self) -> Any:
        """The posture at rest, with the muscles pulling; a tip that is held is held there."""
        state = self.model.initSystem()
        for name, angle in self._posture.items():
            self.model.updCoordinateSet().get(name).setValue(state, angle, False)
            self.model.updCoordinateSet().get(name).setSpeedValue(state, 0.0)
        return state

    def _force(self, state: Any) -> Array:
        """The force (3,) N of the tip on the world."""
        self.model.realizeAcceleration(state)
        recorded = self._device.getRecordValues(state)
        if self._caged:
            first, sign = 0, -1.0  # "cage.distal.force.X" is what the contact does to the bone
        else:
            first, sign = 6, 1.0  # "pointconstraint_distal_Fx" has the sign of a multiplier
        return sign * np.array([recorded.get(first + i) for i in range(3)])

    def _add_segment(self, before: Segment, segment: Segment) -> None:
        import opensim

        ixx, iyy, izz = segment.inertia
        inertia = opensim.Inertia(ixx, iyy, izz, 0, 0, 0)
        body = opensim.Body(segment.name, segment.mass, _vec3(segment.centre), inertia)
        self.model.addBody(body)
        joint = opensim.CustomJoint(
            f"to_{segment.name}",
            self._bodies[before.name],
            _vec3(segment.position),
            opensim.Vec3(0),
            body,
            opensim.Vec3(0),
            opensim.Vec3(0),
            _turns(segment),
        )
        self.model.addJoint(joint)
        self._bodies[segment.name] = body

    def _add_limits(self, law: JointLaw) -> None:
        import opensim

        stiffness, damping = np.radians([law.limit_stiffness, law.limit_damping])
        transition = np.degrees(law.transition)
        for name, low, high in zip(law.joints, law.lower, law.upper, strict=True):
            ends = (np.degrees(high), stiffness, np.degrees(low), stiffness)
            limit = opensim.CoordinateLimitForce(name, *ends, damping, transition)
            limit.setName(f"limit_{name}")
            self.model.addForce(limit)

    def _add_tendons(self, finger: FingerModel, tension: Mapping[str, float]) -> None:
        """Each strand is an actuator of its share of the tension, under a constant control."""
        import opensim

        controller = opensim.PrescribedController()
        controller.setName("constant")
        for tendon in finger.tendons:
            for s, strand in enumerate(tendon.strands):
                actuator = opensim.PathActuator()
                actuator.setName(f"{tendon.name}_{s}")
                actuator.setOptimalForce(strand.share * tension.get(tendon.name, 0.0))
                for k, via in enumerate(strand.path):
                    assert isinstance(via, Via)
                    actuator.addNewPathPoint(f"p{k}", self._bodies[via.body], _vec3(via.point))
                self.model.addForce(actuator)
                controller.addActuator(actuator)
                full = _arguments(opensim.Constant(1.0))
                controller.prescribeControlForActuator(actuator.getName(), full)
        self.model.addController(controller)

    def _add_device(self, finger: FingerModel, contact: TipContact | None) -> None:
        self._caged = contact is not None
        state = self._start()
        self.model.realizePosition(state)
        body, ground = self._bodies[finger.bodies[-1]], self.model.getGround()
        tip = body.findStationLocationInGround(state, _vec3(finger.tip))
        centre = np.array([tip.get(i) for i in range(3)])
        if contact is None:
            self._add_hold(ground, centre, body, finger)
        else:
            self._add_cage(contact, ground, centre, body, finger)

    def _add_hold(self, ground: Any, centre: Array, body: Any, finger: FingerModel) -> None:
        import opensim

        self._device = opensim.PointConstraint(ground, _vec3(centre), body, _vec3(finger.tip))
        self.model.addConstraint(self._device)

    def _add_cage(
        self, contact: TipContact, ground: Any, centre: Array, body: Any, finger: FingerModel
    ) -> None:
        """Six half-spaces about `centre`; OpenSim's is the half x > 0 of its own frame."""
        import opensim

        sphere = opensim.ContactSphere(contact.radius, _vec3(finger.tip), body, "tip")
        self.model.addContactGeometry(sphere)
        cage = self._device = opensim.HuntCrossleyForce()
        cage.setName("cage")
        cage.addGeometry("tip")
        for name, normal, turn in OUTWARD:
            place = _vec3(centre + CAGE_HALF * np.array(normal))
            self.model.addContactGeometry(
                opensim.ContactHalfSpace(place, _vec3(np.radians(turn)), ground, name)
            )
            cage.addGeometry(name)
        cage.setStiffness(contact.stiffness)
        cage.setDissipation(contact.dissipation)
        cage.setStaticFriction(contact.static_friction)
        cage.setDynamicFriction(contact.dynamic_friction)
        cage.setViscousFriction(contact.viscous_friction)
        cage.setTransitionVelocity(contact.transition_velocity)
        self.model.addForce(cage)


def _turns(segment: Segment) -> Any:
    """The hinges of a segment as OpenSim's rotations, and idle axes that complete them."""
    import opensim

    transform = opensim.SpatialTransform()
    axes = [np.array(hinge.axis) for hinge in segment.hinges]
    while len(axes) < 3:
        axes.append(_independent(axes))
    for i, axis in enumerate(axes):
        turn = transform.updTransformAxis(i)
        turn.setAxis(_vec3(axis))
        if i < len(segment.hinges):
            names = opensim.ArrayStr()
            names.append(segment.hinges[i].name)
            turn.setCoordinateNames(names)
            turn.setFunction(_arguments(opensim.LinearFunction(1.0, 0.0)))
        else:
            turn.setFunction(_arguments(opensim.Constant(0.0)))
    return transform


def _independent(axes: Sequence[Array]) -> Array:
    """A unit vector normal to one or two others."""
    if len(axes) == 2:
        return np.cross(axes[0], axes[1])
    helper = np.eye(3)[int(np.argmin(np.abs(axes[0])))]
    out = np.cross(axes[0], helper)
    return out / np.linalg.norm(out)


def _arguments(function: Any) -> Any:
    """The function, now owned by what it is handed to."""
    function.thisown = False
    return function


def _vec3(values: Sequence[float] | Array) -> Any:
    import opensim

    return opensim.Vec3(*(float(v) for v in values))


def twin(muscle: str, caged: bool) -> Settled:
    """What one muscle of the twin comes to, alone, in the cage or held at a point."""
    contact = TipContact() if caged else None
    pull = {muscle: TENSIONS[muscle]}
    return OpenSimFinger(twin_model(), twin_law(), POSTURE, pull, contact).settle()


def figures() -> dict[str, Any]:
    """All of them with their provenance, ready for JSON."""
    import opensim

    settled = {m: {"cage": twin(m, True), "point": twin(m, False)} for m in TENSIONS}
    return {
        "made_by": "python -m tests.proofs.fingers.opensim_twin "
        "tests/data/opensim/twin_opensim.json",
        "engine": f"OpenSim {opensim.GetVersion()}, Runge-Kutta-Merson, accuracy {ACCURACY:g}, "
        f"{DURATION:g} s",
        "units": {"angles": "rad", "rates": "rad/s", "force": "N, of the fingertip on the world"},
        "muscles": {
            muscle: {device: _plain(one) for device, one in both.items()}
            for muscle, both in settled.items()
        },
    }


def _plain(one: Settled) -> dict[str, list[float]]:
    return {
        "angles": one.angles.tolist(),
        "rates": one.rates.tolist(),
        "force": one.force.tolist(),
    }


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(json.dumps(figures(), indent=1) + "\n", encoding="utf-8")
