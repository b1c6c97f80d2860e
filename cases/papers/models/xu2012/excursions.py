"""Section VI as a virtual experiment: the finger moved by hand, markers seen by cameras, tendon
excursions measured and predicted.

The world: cameras in a frame of their own, markers glued near where they were meant to be, a finger
that gives (each marker is off by a shift of its own at every pose, "the finger is somewhat
flexible"), pistons whose limiter lets the adduction tendon go slack.  The analysis knows none of
it: it cuts the record into times of rest (every marker within a ball of 2 mm), aligns the frames by
Procrustes, infers the angles, leaves out poses whose markers are off by more than 7 mm, and
compares tendon lengths.

What the paper does not print, all ours: the shifts' size, chosen for its mean residual of 5 mm; the
cameras' noise; how far the markers are from where they were meant to be; where the limiter stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cases.papers.models.xu2012.calibration import Calibration, Seen, Spread, calibrate
from cosim.port import Array
from rigid.chain.pose import BodyMarkers, estimate
from rigid.fingers import robot_tables as tables
from rigid.fingers.anatomy import RANGES
from rigid.fingers.robot import robot_finger
from rigid.mujoco.finger import MujocoFinger

POSES = 460
BALL = 0.002
"""m: section VI."""
MOST_RESIDUAL = 0.007
"""m: section VI."""
RATE = 120.0
"""1/s, of the cameras (section VI)."""
REST, MOVE = 24, 12
"""Samples of rest at a pose and of the move to the next one (the paper waits "a couple of seconds":
fewer samples make the same averages noisier)."""
BASE = np.array([[-0.04, 0.0, 0.02], [-0.04, 0.02, -0.01], [-0.01, -0.02, 0.01]])
"""m, three markers on the base, in the finger's frame."""
MEANT = BodyMarkers(np.array([1, 3]), np.array([[0.0300, 0.0, 0.0080], [0.0220, 0.0, -0.0050]]))
"""One on the proximal phalanx and one on the fingertip, as in the paper; places are ours."""


START = np.radians([30.0, 0.0, 50.0, 35.0])
"""Amid table II: of the two poses that show the same fingertip, that with a flexed DIP is near."""
SPREAD = Spread(
    0.002,
    np.array([0.0002, 0.0002, 0.0002, 0.001, 0.0002]),
    np.array([True, True, True, True, False]),
)
"""What calibration takes markers and pistons to be off by; the adduction tendon goes slack."""


@dataclass(frozen=True)
class World:
    """What the analysis does not know; m."""

    seed: int = 0
    noise: float = 0.0002
    """Noise of a camera's coordinate at one time, m."""
    give: float = 0.002
    """Standard deviation of each coordinate of a marker's shift at a pose."""
    misplaced: tuple[tuple[float, float, float], ...] = (
        (0.005, 0.006, -0.004),
        (-0.003, 0.005, -0.003),
    )
    """From where the markers were meant to be to where they are."""
    limiter: float = 0.55
    """Share of the adduction tendon's excursion over all poses beyond which its piston does not
    go."""
    noisy: tuple[float, ...] = (0.0002, 0.0002, 0.0002, 0.001, 0.0002)
    """By tendon: what a pose's excursion is off by; the abduction tendon presses on the capsule."""
    turn: tuple[float, float, float] = (0.4, -0.7, 1.1)
    shift: tuple[float, float, float] = (0.8, -0.3, 1.2)
    """Rotation vector and origin of the finger in the cameras' frame."""


@dataclass(frozen=True)
class CameraRecord:
    """What was recorded, at `RATE`: base (nt, 3, 3), finger (n, nm, 3) and pistons (n, 5), m, in
    the cameras' frame; pistons are seen along their own cylinders."""

    base: Array
    finger: Array
    piston: Array


@dataclass(frozen=True)
class Truth:
    """What only the virtual world knows."""

    angle: Array
    markers: BodyMarkers
    zero: Array
    length: Array
    """(poses, 5) m, of the tendons at the poses."""


@dataclass(frozen=True)
class Found:
    """What the analysis makes of a record."""

    seen: Seen
    """Measurements of the poses kept, in the finger's frame."""
    residual: Array
    """(poses,) m, of all poses found."""
    angle: Array
    """(kept, 4) rad."""

    @property
    def measured_excursions(self) -> Array:
        """The measured excursions (kept, 5) m, from their means."""
        return np.asarray(self.seen.piston - self.seen.piston.mean(axis=0))

    def predicted_excursions(self, finger: MujocoFinger) -> Array:
        """The excursions (kept, 5) m that the angles predict, from their means."""
        length = np.array([finger.tendon_lengths(q) for q in self.angle])
        return np.asarray(length - length.mean(axis=0))


def record_excursions(world: World, poses: int = POSES) -> tuple[CameraRecord, Truth]:
    """The finger led to random poses of table II and left at rest at each."""
    rng = np.random.default_rng(world.seed)
    finger = MujocoFinger(robot_finger())
    low, high = np.array([RANGES[j] for j in tables.JOINTS]).T
    angle = rng.uniform(low, high, (poses, 4))
    place = MEANT.place + np.array(world.misplaced)
    markers = BodyMarkers(MEANT.body, place)
    length = np.array([finger.tendon_lengths(q) for q in angle])
    point = np.array([markers.at(finger, q)[0] for q in angle])
    point += rng.normal(0.0, world.give, point.shape)
    zero: Array = rng.uniform(-0.02, 0.02, (length.shape[1],))
    piston = length + rng.normal(0.0, 1.0, length.shape) * np.array(world.noisy)
    stop = np.quantile(length[:, 4], world.limiter)
    piston[:, 4] = np.minimum(piston[:, 4], stop)
    turn, shift = Rotation.from_rotvec(world.turn).as_matrix(), np.array(world.shift)
    moving = _course(np.hstack([point.reshape(poses, -1), piston + zero]))
    moving += rng.normal(0.0, world.noise, moving.shape)
    count = 3 * len(place)
    seen = moving[:, :count].reshape(len(moving), -1, 3) @ turn.T + shift
    base = BASE @ turn.T + shift + rng.normal(0.0, world.noise, (len(moving), 3, 3))
    return CameraRecord(base, seen, moving[:, count:]), Truth(angle, markers, zero, length)


def _course(at: Array) -> Array:
    """A course in samples (n, k): rest at each row of `at`, then a straight move to the next."""
    part = np.concatenate([np.zeros(REST), np.arange(1, MOVE) / MOVE])
    ahead = np.vstack([at[1:], at[-1:]])
    return np.concatenate([a + part[:, None] * (b - a) for a, b in zip(at, ahead, strict=True)])


def rests(record: CameraRecord) -> list[slice]:
    """Times in which every marker, the pistons' too, stays within a ball of 2 mm about where it
    was at first, apart from each other; shorter than half a wait do not count."""
    points = np.concatenate(
        [record.finger, record.piston[:, :, None] * np.array([1.0, 0.0, 0.0])], axis=1
    )
    out, first = [], 0
    for k in range(1, len(points) + 1):
        stays = k < len(points)
        stays = stays and float(np.linalg.norm(points[k] - points[first], axis=1).max()) <= BALL
        if not stays:
            if k - first >= REST // 2:
                out.append(slice(first, k))
            first = k
    return out


def procrustes(model: Array, seen: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) that take points seen (n, 3) nearest to the model's (n, 3):
    about their means, by the singular values of their moment (Schoenemann 1966), kept proper."""
    mean_model, mean_seen = model.mean(axis=0), seen.mean(axis=0)
    u, _, vt = np.linalg.svd((model - mean_model).T @ (seen - mean_seen))
    keep = np.diag([1.0, 1.0, float(np.sign(np.linalg.det(u @ vt)))])
    turn = u @ keep @ vt
    return turn, mean_model - turn @ mean_seen


def average(record: CameraRecord) -> Seen:
    """The times of rest, in the finger's frame."""
    turn, shift = procrustes(BASE, record.base.mean(axis=0))
    times = rests(record)
    marker = np.array([record.finger[t].mean(axis=0) for t in times]) @ turn.T + shift
    return Seen(marker, np.array([record.piston[t].mean(axis=0) for t in times]))


def analyse(record: CameraRecord, markers: BodyMarkers = MEANT) -> Found:
    """Section VI's analysis with the markers where they were meant to be."""
    finger, seen = MujocoFinger(robot_finger()), average(record)
    poses = [estimate(finger, markers, x, START) for x in seen.marker]
    residual = np.array([p.residual for p in poses])
    kept = residual <= MOST_RESIDUAL
    angle = np.array([p.angle for p in poses])[kept]
    return Found(Seen(seen.marker[kept], seen.piston[kept]), residual, angle)


def recalibrate(found: Found, markers: BodyMarkers = MEANT) -> Calibration:
    """The places of the markers, from the poses kept."""
    return calibrate(MujocoFinger(robot_finger()), markers, found.seen, found.angle, SPREAD)
