"""The finger in motion and at rest: against OpenSim, closed forms, and its own static solution."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from math import pi
from typing import Any, NamedTuple

import numpy as np

from cosim.port import Array
from meshes.skeleton import JOINTS, index_finger
from rigid.chain.joint_torques import joint_law
from rigid.fingers.index import finger_model
from rigid.mujoco.dynamics import ConstantTension, FingerDynamics
from rigid.mujoco.finger import MujocoFinger
from rigid.mujoco.implicit_step import device_response
from rigid.mujoco.tip_device import Cage, Device, Shell, TipContact
from tests.helpers.fingers import at_rest
from tests.helpers.folders import TEST_DATA
from tests.helpers.rows import Row
from tests.proofs.fingers.forward import Simulation, simulate
from tests.proofs.fingers.thesis_twin import LIMIT_DAMPING, POSTURE, TENSIONS, twin_law, twin_model

FIGURES = TEST_DATA / "opensim" / "twin_opensim.json"
THESIS = "Jadelis, thesis, section 3.1: below 0.02 N between its two devices"
PASSIVE = 0.0391
"""N m/rad, mean of four index MCPs (PMC7775510, table 2); the other joints are assumed alike."""
ALONE = {"EDC": ("EDC",), "EI": ("EI",), "LUM": ("LUM",), "FPI": ("FPI",)} | {
    "FDP": ("FDP",),
    "FDS": ("FDS",),
    "FDI": ("FDIm", "FDIl"),
}
PULL = {**TENSIONS, "FDIm": 3.64, "FDIl": 3.64}
"""N, of each muscle that pulls (thesis, table 2: 10 %, of the first dorsal interosseous 5 %)."""


def rows() -> Iterator[Row]:
    """All but those that measure time."""
    yield from contact_rows()
    yield from twin_rows(json.loads(FIGURES.read_text(encoding="utf-8")))
    if find_spec("opensim") is not None:
        yield from live_rows()
    yield from sensitivity_rows()
    yield from rest_rows()


def contact_rows() -> Iterator[Row]:
    """The devices' forces at 10 um of depth against integrals of the published laws."""
    contact, depth, still = TipContact(), 1e-5, np.zeros(6)
    cage, shell = Cage(contact), Shell(contact)
    hertz = 4 / 3 * contact.stiffness / 2**1.5 * np.sqrt(contact.radius) * depth**1.5
    found = -wrench(cage, np.array([cage.gap + depth, 0, 0]), still).wrench[0]
    source = "Hertz's law with Simbody's effective modulus of two equal bodies"
    yield Row("cage", "force N", hertz, float(found), 1e-9, source)
    found = -wrench(shell, np.array([shell.gap + depth, 0, 0]), still).wrench[0]
    source = "elastic foundation, 400 000 springs over the inside of the shell"
    yield Row("shell", "force N", _springs(shell, shell.gap + depth), float(found), 1e-6, source)


def _springs(shell: Shell, d: float) -> float:
    """The force, N, along the line of centres, summed over rings of the hollow sphere about that
    line."""
    n, outer = 400_000, shell.width / 2
    edge = np.arccos((outer**2 + d**2 - shell.contact.radius**2) / (2 * outer * d))
    angle = (np.arange(n) + 0.5) * edge / n
    along, across = outer * np.cos(angle) - d, outer * np.sin(angle)
    distance = np.hypot(along, across)
    area = 2 * pi * outer**2 * np.sin(angle) * edge / n
    depth = shell.contact.radius - distance
    return float((shell.contact.stiffness * depth * along / distance * area).sum())


def twin_rows(figures: dict[str, Any]) -> Iterator[Row]:
    """Fingertip forces of the twin after 2 s, by muscle and device."""
    finger = MujocoFinger(twin_model(), law=twin_law())
    for muscle, devices in figures["muscles"].items():
        for kind, theirs in devices.items():
            device = Cage() if kind == "cage" else None
            found = _simulate(finger, (muscle,), device).force[-1]
            name = f"twin, {muscle} {TENSIONS[muscle]} N, {kind}"
            yield from _force_rows(name, found, np.array(theirs["force"]), figures["engine"])


def live_rows() -> Iterator[Row]:
    """The same, of the twin held at a point, which OpenSim solves in a second or so."""
    import opensim

    from tests.proofs.fingers.opensim_twin import twin

    source = f"OpenSim {opensim.GetVersion()}, installed"
    finger = MujocoFinger(twin_model(), law=twin_law())
    for muscle in TENSIONS:
        found = _simulate(finger, (muscle,), None).force[-1]
        yield from _force_rows(f"twin, {muscle}, live", found, twin(muscle, False).force, source)


def _force_rows(name: str, found: Array, theirs: Array, engine: str) -> Iterator[Row]:
    sizes = float(np.linalg.norm(theirs)), float(np.linalg.norm(found))
    turn = np.degrees(np.arctan2(np.linalg.norm(np.cross(found, theirs)), found @ theirs))
    yield Row(name, "fingertip force N", *sizes, 0.01, engine)
    yield Row(name, "direction apart deg", 0.0, float(turn), 1.0, engine, "absolute")


def sensitivity_rows() -> Iterator[Row]:
    """Magnitudes of the fingertip force between the devices: of the thesis's dynamic model, whose
    joints only limits hold, and of the index finger, which has passive stiffness besides."""
    twin = MujocoFinger(twin_model(), law=twin_law())
    for muscle in TENSIONS:
        yield from _device_rows(f"device sensitivity, twin, {muscle}", twin, (muscle,), True)
    index = settling_index_finger()
    for name, muscles in ALONE.items():
        yield from _device_rows(f"device sensitivity, index finger, {name}", index, muscles, False)


def _device_rows(
    name: str, finger: MujocoFinger, muscles: tuple[str, ...], bound: bool
) -> Iterator[Row]:
    devices: tuple[Device | None, ...] = (None, Cage(), Shell())
    ran = [_simulate(finger, muscles, device) for device in devices]
    point, cage, shell = (float(np.linalg.norm(s.force[-1])) for s in ran)
    if ran[1].at_rest and ran[2].at_rest:
        apart = abs(cage - shell)
        if bound:
            yield Row(name, "cage less shell N", 0.02, apart, 0.0, THESIS, "bound")
        else:
            yield Row(name, "cage less shell N", 0.0, apart, 0.02, THESIS, "comparison")
    rest = "" if ran[1].at_rest else ", still creeping in the cage after 2 s"
    yield Row(name, f"point, cage N{rest}", point, cage, 0.02, THESIS, "comparison")


def rest_rows() -> Iterator[Row]:
    """The static solution of the index finger against 2 s of motion, held at a point."""
    finger = settling_index_finger()
    start = finger.start(POSTURE)
    for name, muscles in ALONE.items():
        _, balance = at_rest(finger, start, pull_of(finger, muscles))
        apart = np.abs(_simulate(finger, muscles, None).force[-1] - balance.tip_force).max()
        source = "2 s of steps of 1 ms"
        quantity = "reaction of the static solve apart N"
        yield Row(f"static, {name}", quantity, 1e-4, float(apart), 0.0, source, "bound")


def settling_index_finger() -> MujocoFinger:
    """The index finger with a fixed extensor split, linear passive joints at rest in the posture,
    limits of +-5 deg about it, damped as the twin's."""
    stiffness = dict.fromkeys(JOINTS, PASSIVE)
    law = joint_law(JOINTS, stiffness, POSTURE).hold_about(POSTURE)
    model = finger_model(index_finger(), central=0.5)
    return MujocoFinger(model, law=replace(law, limit_damping=LIMIT_DAMPING))


def pull_of(finger: MujocoFinger, muscles: tuple[str, ...]) -> Array:
    return np.array([PULL[t] if t in muscles else 0.0 for t in finger.tendons])


def _simulate(finger: MujocoFinger, muscles: tuple[str, ...], device: Device | None) -> Simulation:
    pull = ConstantTension(pull_of(finger, muscles))
    return simulate(FingerDynamics(finger, finger.start(POSTURE), pull, device))


class Wrench(NamedTuple):
    """What a device does to the sphere, with its exact derivatives."""

    wrench: Array
    """(6,) N and N m about the sphere's centre."""
    by_position: Array
    """(6, 3)."""
    by_twist: Array
    """(6, 6)."""


def wrench(device: Device, position: Array, twist: Array) -> Wrench:
    """The wrench on the sphere at a position (3,) m and twist (6,) in the device's axes."""
    return Wrench(*device_response(device.surface, position, twist, True))
