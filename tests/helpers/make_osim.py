"""Makes the finger that the import of OpenSim's files is checked with, and OpenSim's figures of it.

Run by a Python that has the package `opensim`:

    python -m tests.helpers.make_osim tests/data/opensim

It writes finger.osim, and finger_opensim.json with lengths and moment arms at 20 random postures.

The description is ours: segments of 46/28/20 mm, the paths of the normative model of An et al. 1979
(doi 10.1016/0021-9290(79)90163-5) in units of 20 mm, muscles of Table 2 of Jadelis's thesis.
Frames: x distal, y radial, z dorsal; flexion and radial abduction positive.  Everything that the
importer reads comes once: axes askew, constants, multipliers, offset and welded frames, a wrap.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import opensim as osim

LENGTHS = {"metacarpal": 0.0, "proximal": 0.046, "middle": 0.028, "distal": 0.020}
UNIT = 0.020
OFFSET = {"DIP": 0.224, "PIP": 0.288, "MCP": 0.432}
SIDES = {
    "MCP": ("metacarpal", "proximal"),
    "PIP": ("proximal", "middle"),
    "DIP": ("middle", "distal"),
}
# x distal, y dorsal, z radial, in units; before and after each joint.
PATHS = {
    "FDP": {
        "MCP": ((-0.400, -0.559, 0.004), (0.118, -0.386, 0.031)),
        "PIP": ((-0.400, -0.409, 0.027), (0.212, -0.308, 0.009)),
        "DIP": ((-0.300, -0.245, 0.054), (-0.004, -0.184, 0.026)),
    },
    "FDS": {
        "MCP": ((-0.400, -0.589, -0.114), (0.118, -0.477, -0.074)),
        "PIP": ((-0.400, -0.311, 0.028), (0.212, -0.249, 0.015)),
    },
    "FDI": {"MCP": ((-0.400, -0.262, 0.450), (0.318, -0.033, 0.443))},
    "LUM": {
        "MCP": ((-0.400, -0.404, 0.441), (0.318, -0.148, 0.370)),
        "PIP": ((-0.100, 0.181, 0.268), (0.112, 0.186, 0.223)),
    },
    "FPI": {
        "MCP": ((-0.400, -0.279, -0.442), (0.318, -0.039, -0.461)),
        "PIP": ((-0.100, 0.131, -0.312), (0.112, 0.151, -0.290)),
    },
    "EI": {
        "MCP": ((0.0, 0.483, -0.026), (0.018, 0.421, -0.033)),
        "PIP": ((0.0, 0.266, -0.026), (0.038, 0.278, -0.027)),
        "DIP": ((0.0, 0.100, -0.009), (-0.004, 0.199, -0.010)),
    },
    # Points far enough from the joint for the cylinder to lie between them.
    "EDC": {"MCP": ((-1.0, 0.45, -0.026), (0.9, 0.42, -0.033))},
    "over_sphere": {"MCP": ((-1.0, 0.45, 0.1), (0.9, 0.42, 0.05))},  # no muscle: a path alone
}
WRAPPED = {"EDC": "mcp_head", "over_sphere": "mcp_ball"}
# F0 (N), fibre and tendon slack length (m), pennation (deg).
MUSCLES = {
    "FDP": (79.12, 0.075, 0.26812, 7.0),
    "FDS": (58.9, 0.084, 0.29932, 6.0),
    "FDI": (72.8, 0.030, 0.02520, 15.0),
    "EDC": (34.69, 0.070, 0.26468, 3.0),
    "FPI": (30.94, 0.031, 0.08978, 6.3),
    "EI": (35.47, 0.059, 0.18479, 6.0),
    "LUM": (25.04, 0.068, 0.05470, 1.2),
}
WRAP_RADIUS = 0.0085
RANGES = {  # deg
    "MCP_abduction": (-20.0, 20.0),
    "MCP": (-20.0, 85.0),
    "PIP": (0.0, 100.0),
    "DIP": (0.0, 70.0),
}
DEFAULTS = {"MCP_abduction": 0.0, "MCP": 30.0, "PIP": 45.0, "DIP": 15.0}
POSTURES = 20
SEED = 4


def vec3(values):
    return osim.Vec3(*[float(v) for v in values])


def release(function):
    """The function, now owned by the model that it is handed to."""
    function.thisown = False
    return function


def segment(name):
    length = LENGTHS[name]
    mass = 0.3 * length
    across = mass * length**2 / 12
    inertia = osim.Inertia(across / 10, across, 1.05 * across, 1e-9, -2e-9, 1e-9)
    return osim.Body(name, mass, osim.Vec3(length / 2, 2e-4, -3e-4), inertia)


def set_rotation(transform, axis, direction, function, coordinate=None):
    getattr(transform, f"upd_{axis}")().setAxis(vec3(direction))
    getattr(transform, f"upd_{axis}")().setFunction(release(function))
    if coordinate:
        names = osim.ArrayStr()
        names.append(coordinate)
        getattr(transform, f"upd_{axis}")().setCoordinateNames(names)


def mcp(ground, proximal):
    transform = osim.SpatialTransform()
    # -(-1) q and q + 0.02 rad: a multiplier and a constant that the importer must keep.
    reversed_ = osim.MultiplierFunction(release(osim.LinearFunction(-1.0, 0.0)), -1.0)
    set_rotation(transform, "rotation1", (0, 0.02, 1), reversed_, "MCP_abduction")
    set_rotation(transform, "rotation2", (0.03, 1, 0), osim.LinearFunction(1.0, 0.02), "MCP")
    set_rotation(transform, "rotation3", (1, 0, 0), osim.Constant(0.05))
    set_rotation(transform, "translation1", (1, 0, 0), osim.Constant(0.0007))
    set_rotation(transform, "translation2", (0, 1, 0), osim.Constant(-0.0003))
    set_rotation(transform, "translation3", (0, 0, 1), osim.Constant(0.0))
    return osim.CustomJoint(
        "mcp",
        ground,
        vec3((0.001, -0.0005, 0.0004)),
        vec3((0.02, -0.01, 0.03)),
        proximal,
        vec3((0.0002, 0.0001, -0.0003)),
        vec3((-0.01, 0.02, 0.015)),
        transform,
    )


def pip(proximal, middle):
    """A pin about its frames' z axis, laid along y and somewhat askew."""
    return osim.PinJoint(
        "pip",
        proximal,
        vec3((LENGTHS["proximal"], 0, 0)),
        vec3((-np.pi / 2, 0.04, 0.02)),
        middle,
        vec3((0, 0, 0)),
        vec3((-np.pi / 2, 0.03, 0.0)),
    )


def dip(middle, distal):
    transform = osim.SpatialTransform()
    set_rotation(transform, "rotation1", (0.0, -1.0, 0.05), osim.LinearFunction(-1.0, 0.0), "DIP")
    return osim.CustomJoint(
        "dip",
        middle,
        vec3((LENGTHS["middle"], 0, 0)),
        vec3((0, 0, 0)),
        distal,
        vec3((0, 0, 0)),
        vec3((0, 0, 0)),
        transform,
    )


def nail(distal, body):
    ahead = vec3((0.012, 0, 0.002))
    return osim.WeldJoint(
        "nail", distal, ahead, vec3((0, 0.1, 0)), body, vec3((0,) * 3), vec3((0,) * 3)
    )


def set_coordinates(joint, names):
    for i, name in enumerate(names):
        coordinate = joint.upd_coordinates(i)
        coordinate.setName(name)
        low, high = np.radians(RANGES[name])
        coordinate.setRangeMin(float(low))
        coordinate.setRangeMax(float(high))
        coordinate.setDefaultValue(float(np.radians(DEFAULTS[name])))
        coordinate.setDefaultClamped(name == "DIP")


def path_points(name):
    """(body, point in m) from origin to insertion."""
    out = []
    for joint, sides in PATHS[name].items():
        for body, point, after in zip(SIDES[joint], sides, (False, True), strict=True):
            x, dorsal, radial = point
            centre = OFFSET[joint] if after else LENGTHS[body] / UNIT
            out.append((body, UNIT * np.array([x + centre, radial, dorsal])))
    body, first = out[0]
    return [(body, first - [0.040, 0.0, 0.0]), *out]


def muscle(name):
    f0, fibre, slack, pennation = MUSCLES[name]
    out = osim.Millard2012EquilibriumMuscle(name, f0, fibre, slack, float(np.radians(pennation)))
    if name == "LUM":
        out.set_ignore_tendon_compliance(True)
    return out


def build():
    model = osim.Model()
    model.setName("finger")
    model.setGravity(vec3((0.0, 0.0, -9.81)))
    bodies = {name: segment(name) for name in LENGTHS if LENGTHS[name]}
    plate = osim.Body("nail_plate", 2e-4, vec3((0.001, 0, 0)), osim.Inertia(1e-9, 2e-9, 2e-9))
    for body in (*bodies.values(), plate):
        model.addBody(body)
    frames = {"metacarpal": model.getGround(), **bodies}
    tip = osim.PhysicalOffsetFrame("pulp", plate, osim.Transform(vec3((0.006, 0.0, -0.003))))
    tip.set_orientation(vec3((0.1, 0.2, 0.3)))
    plate.addComponent(tip)
    joints = (
        (mcp(frames["metacarpal"], bodies["proximal"]), ("MCP_abduction", "MCP")),
        (pip(bodies["proximal"], bodies["middle"]), ("PIP",)),
        (dip(bodies["middle"], bodies["distal"]), ("DIP",)),
        (nail(bodies["distal"], plate), ()),
    )
    for joint, names in joints:
        model.addJoint(joint)
        joint.finalizeFromProperties()
        set_coordinates(joint, names)
    add_wraps(frames["proximal"])
    for name in PATHS:
        add_muscle(model, name, frames, tip)
    add_passive(model)
    model.addMarker(osim.Marker("tip", tip, vec3((0.001, 0.0, 0.0))))
    model.finalizeConnections()
    return model


def add_wraps(proximal):
    wrap = osim.WrapCylinder()
    wrap.setName("mcp_head")
    wrap.set_radius(WRAP_RADIUS)
    wrap.set_length(0.04)
    wrap.set_xyz_body_rotation(vec3((np.pi / 2, 0.02, 0.01)))
    wrap.set_translation(vec3((0.0005, 0.0, -0.001)))
    wrap.set_quadrant("+y")  # dorsal
    proximal.addWrapObject(wrap)
    ball = osim.WrapSphere()
    ball.setName("mcp_ball")
    ball.set_radius(WRAP_RADIUS)
    ball.set_translation(vec3((0.0005, 0.0005, -0.001)))
    ball.set_quadrant("all")
    proximal.addWrapObject(ball)


def add_muscle(model, name, frames, tip):
    force = muscle(name) if name in MUSCLES else osim.PathActuator()
    force.setName(name)
    for k, (body, point) in enumerate(path_points(name)):
        force.addNewPathPoint(f"{name}_{k}", frames[body], vec3(point))
    if name == "FDP":  # a last point in a frame that is offset, of a body that is welded
        force.addNewPathPoint("FDP_pulp", tip, vec3((-0.002, 0.0005, -0.001)))
    model.addForce(force)
    if name in WRAPPED:
        path = osim.GeometryPath.safeDownCast(force.updPropertyByName("path").updValueAsObject())
        path.addPathWrap(frames["proximal"].getWrapObject(WRAPPED[name]))
        around = path.getWrapSet().get(0).updPropertyByName("range")
        for end, point in enumerate((2, 3)):  # the segment across the joint
            osim.PropertyHelper.setValueInt(point, around, end)


def add_passive(model):
    for name in RANGES:
        low, high = DEFAULTS[name] - 5, DEFAULTS[name] + 5
        limit = osim.CoordinateLimitForce(name, high, 20.0, low, 20.0, 0.01, 5.0)
        limit.setName(f"{name}_limit")
        model.addForce(limit)
    spring = osim.SpringGeneralizedForce("MCP")
    spring.setName("MCP_spring")
    spring.setStiffness(0.0391)
    spring.setRestLength(0.5)
    spring.setViscosity(0.001)
    model.addForce(spring)


def figures(model):
    """At random postures: lengths (n, paths) m, moment arms (n, paths, coordinates) m/rad, mass
    matrices (n, coordinates, coordinates) kg m2."""
    state = model.initSystem()
    coordinates = [model.getCoordinateSet().get(name) for name in RANGES]
    low, high = np.radians(list(RANGES.values())).T
    postures = np.random.default_rng(SEED).uniform(low, high, (POSTURES, len(low)))
    lengths, arms, masses, matrix = [], [], [], osim.Matrix()
    for posture in postures:
        for coordinate, angle in zip(coordinates, posture, strict=True):
            coordinate.setValue(state, float(angle), False)
        model.realizePosition(state)
        model.getMatterSubsystem().calcM(state, matrix)
        masses.append(matrix.to_numpy().tolist())
        paths = {n: osim.PathActuator.safeDownCast(model.getForceSet().get(n)) for n in PATHS}
        lengths.append([paths[name].getLength(state) for name in PATHS])
        arms.append(
            [[paths[name].computeMomentArm(state, c) for c in coordinates] for name in PATHS]
        )
    return {
        "postures": postures.tolist(),
        "lengths": lengths,
        "moment_arms": arms,
        "mass_matrices": masses,
    }


def main(folder):
    model = build()
    model.printToXML(str(folder / "finger.osim"))
    data = {
        "provenance": f"OpenSim {osim.GetVersion()}: PathActuator.getLength and computeMomentArm, "
        "calcM of finger.osim; both files made by tests/helpers/make_osim.py",
        "units": "m, rad; moment arms are -d length / d coordinate",
        "coordinates": list(RANGES),
        "paths": list(PATHS),
        "wrapped": list(WRAPPED),
        **figures(osim.Model(str(folder / "finger.osim"))),
    }
    (folder / "finger_opensim.json").write_text(json.dumps(data) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
