"""Friction along tendons against the capstan's law, plain MuJoCo, and the closed form of a loop."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from cosim.port import Array
from meshes.skeleton import index_finger
from rigid.chain.kinematics import body_jacobian
from rigid.fingers.index import finger_model
from rigid.fingers.robot import robot_finger
from rigid.model import FingerModel, Hinge, Segment, Strand, Tendon, Via, WrapCylinder
from rigid.mujoco.finger import MujocoFinger
from rigid.mujoco.tendon_friction import FrictionStep, TendonFriction
from tests.helpers.rows import Row

CAPSTAN = "Euler 1762: T exp(-mu theta)"
MU, RADIUS, TENSION = 0.15, 0.01, 6.0
"""Coefficient, m of the wheel, N."""
LEAD = np.pi / 3
"""rad, by which the tendon turns at its guide point before the wheel."""
TURNED = (0.3, 1.2)
"""rad, between which the joint turns to and fro."""
PRESLIDING = 1e-6
STEPS = 250


def wheel_finger() -> FingerModel:
    """One phalanx on a hinge about y, extended by a tendon that turns by LEAD at a guide point and
    then by the joint's angle round a wheel about the joint: the tendon leaves the wheel towards a
    point of the phalanx at the wheel's height."""
    bend = np.array([np.cos(LEAD), 0.0, np.sin(LEAD)])
    guide = np.array([0.0, 0.0, RADIUS])
    origin = guide - 0.03 * bend
    path = (
        Via("metacarpal", tuple(origin)),
        Via("metacarpal", tuple(guide)),
        WrapCylinder("metacarpal", (0.05, 0.0, 0.0), (0.0, 1.0, 0.0), RADIUS, (0.05, 0.0, 0.03)),
        Via("proximal", (0.03, 0.0, RADIUS)),
    )
    segments = (
        Segment("metacarpal", 0.05),
        Segment(
            "proximal",
            0.04,
            position=(0.05, 0.0, 0.0),
            hinges=(Hinge("MCP", (0.0, 1.0, 0.0)),),
            mass=0.02,
            inertia=(1e-6, 1e-6, 1e-6),
        ),
    )
    tendon = Tendon("extensor", (Strand(path),))
    return FingerModel("wheel", segments, (0.04, 0.0, 0.0), (tendon,))


def rubbing_wheel(sliding: str = "loading") -> MujocoFinger:
    """`wheel_finger` with friction at guide and wheel."""
    friction = TendonFriction(MU, sliding, PRESLIDING)  # type: ignore[arg-type]
    return MujocoFinger(wheel_finger()).with_friction({"extensor": friction})


def wheel_rows() -> Iterator[Row]:
    """The torque of a tendon that is turned by a known angle, sliding either way."""
    for sliding, sign in (("loading", -1.0), ("unloading", 1.0)):
        finger = rubbing_wheel(sliding)
        off = []
        for angle in np.linspace(*TURNED, 10):
            torque = finger.own_torques(np.array([angle]), np.array([TENSION]))["extensor"][0]
            exact = -TENSION * RADIUS * np.exp(sign * MU * (LEAD + angle))
            off.append(abs(torque / exact - 1))
        name = f"tendon over a wheel, {sliding}"
        yield Row(name, "torque off T r exp(-/+ mu theta)", 1e-9, max(off), 0.0, CAPSTAN, "bound")


def cycle_of_wheel() -> tuple[float, float, float]:
    """J that guide and wheel take as the joint is turned to and fro once, slowly, under TENSION: by
    the steps' books, by the loop of torque over angle, and in closed form."""
    finger = rubbing_wheel()
    low, high = TURNED
    there = np.linspace(low, high, STEPS + 1)
    turns = np.diff(np.concatenate([there, there[-2::-1]]))
    angle, lost, loop = low, 0.0, 0.0
    assert finger.guides is not None
    grip, tension = -finger.guides.grip, np.array([TENSION])
    for turn in np.concatenate([turns, turns]):
        at = np.array([angle + 0.5 * turn])
        arms = finger.moment_arms(at)
        step = FrictionStep(
            finger.guides.read(finger.at_angles(at)),
            finger.guides.presliding,
            arms,
            grip,
            tension,
            np.zeros(1),
            np.zeros(1),
        )
        grip = step.grip_after(np.array([turn]))
        lost += 0.5 * step.work(grip, np.array([turn]), tension).lost
        loop -= 0.5 * TENSION * float(step.readings.arms(grip, arms)[0, 0]) * turn
        angle += turn
    first, last = np.exp(MU * (LEAD + np.array(TURNED)))
    exact = TENSION * RADIUS / MU * ((1 / last - 1 / first) + (last - first))
    return lost, loop, float(exact)


def loop_rows() -> Iterator[Row]:
    """The energy of a hysteresis loop."""
    lost, loop, exact = cycle_of_wheel()
    name, source = "tendon over a wheel, to and fro", "integral of the capstan's law"
    yield Row(name, "energy lost, mJ", 1e3 * exact, 1e3 * lost, 5e-4, source)
    yield Row(name, "area of torque over angle, mJ", 1e3 * exact, 1e3 * loop, 1e-6, source)


def peer_torques(finger: MujocoFinger, angles: Array, tension: Array, grip: Array) -> Array:
    """The joints' torques (nq,) N m of the tendons in plain MuJoCo: every straight part is a tendon
    of its own between two sites, with an actuator that has the part's tension."""
    assert finger.guides is not None
    data = finger.at_angles(angles)
    parts = finger.guides.straight_parts(data, tension, grip)
    spec = mujoco.MjSpec.from_string(finger.xml)
    for tendon in list(spec.tendons):
        spec.delete(tendon)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for k, (ends, bodies, _) in enumerate(parts):
        tendon = spec.add_tendon(name=f"part {k}")
        for end, body, which in zip(ends, bodies, "ab", strict=True):
            turn = data.xmat[body].reshape(3, 3)
            place = turn.T @ (end - data.xpos[body])
            spec.body(finger.model.body(body).name).add_site(name=f"{which} {k}", pos=place)
            tendon.wrap_site(f"{which} {k}")
        actuator = spec.add_actuator(name=f"part {k}", target=f"part {k}")
        actuator.trntype = mujoco.mjtTrn.mjTRN_TENDON
    model = spec.compile()
    peer = mujoco.MjData(model)
    peer.qpos[:] = angles
    peer.ctrl[:] = [-force for _, _, force in parts]
    mujoco.mj_forward(model, peer)
    return np.array(peer.qfrc_actuator)


def finger_rows() -> Iterator[Row]:
    """Fingers with all tendons rubbing, in random postures: torques beside plain MuJoCo's, and
    power."""
    rng = np.random.default_rng(65)
    models = (finger_model(index_finger(), central=0.5), robot_finger())
    for name, model in zip(("index finger", "robotic finger"), models, strict=True):
        bare = MujocoFinger(model)
        finger = bare.with_friction({t: TendonFriction(MU) for t in bare.tendons})
        assert finger.guides is not None
        apart, unaccounted, moved = [], [], []
        for _ in range(20):
            q, v = rng.uniform(0.0, 1.0, 4), rng.normal(size=4)
            tension = rng.uniform(1.0, 9.0, len(bare.tendons))
            grip = rng.uniform(-1.0, 1.0, len(finger.guides.owner))
            arms = bare.moment_arms(q)
            readings = finger.guides.read(finger.at_angles(q))
            torque = tension @ readings.arms(grip, arms)
            apart.append(np.abs(peer_torques(finger, q, tension, grip) / torque - 1).max())
            before, beyond = tension[readings.owner] * readings.factors(grip)
            taken = (before - beyond) @ (readings.slides @ v)
            wrenches = finger.own_wrenches(q, tension, grip)
            pulled = sum(wrenches[t] for t in bare.tendons)
            bones = np.ravel(pulled) @ body_jacobian(finger.chain(q)) @ v
            muscles = tension @ arms @ v
            unaccounted.append(abs(muscles - bones - taken))
            moved.append(abs(muscles))
        where = f"{name}, all tendons with friction, 20 postures"
        yield Row(
            where, "torques off plain MuJoCo's, each straight part a tendon, relative", 1e-8,
            max(apart), 0.0, "MuJoCo", "bound",
        )  # fmt: skip
        yield Row(
            where, "power of muscles less bones' less guides', relative", 1e-12,
            max(unaccounted) / max(moved), 0.0, "virtual work", "bound",
        )  # fmt: skip


def rows() -> Iterator[Row]:
    """All of them."""
    yield from wheel_rows()
    yield from loop_rows()
    yield from finger_rows()
