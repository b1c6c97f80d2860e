"""The contract between a hood and a finger: two power-conjugate pairs and nothing else.

    finger --Motion (poses of the shared bodies)-->       hood
    finger <--Load (a wrench per body and per source)--   hood
    muscle --tension (N) per tendon-->                    hood
    muscle <--excursion (m) per tendon--                  hood

SI units, one right-handed world frame, moments about each body's origin.  A state is an opaque
value: `advance` returns a new one and leaves the old one as it was, so that a step can be
repeated, which is all that implicit coupling, checkpoints and rollback need.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Mask = NDArray[np.bool_]
Triangles = tuple[Array, np.ndarray]
"""Corners (n, 3), m, and the triangles between them (m, 3)."""
State = Any

AXES = ("distal", "radial", "dorsal")
"""The world's x, y, z, fixed to the metacarpal."""
Hand = Literal["right", "left"]
"""The side of a finger.  Everything within the program is a right hand's, whose axes AXES are
right-handed; a left hand is its mirror image, and `mirror` leads to and from its own frame."""
STATIC = math.inf
"""The time step that asks `Hood.advance` for static equilibrium."""


def skew(vector: Array) -> Array:
    """Cross-product matrices: (..., 3) -> (..., 3, 3), skew(a) @ b = a x b.

    >>> skew([1.0, 0.0, 0.0]) @ [0.0, 1.0, 0.0]
    array([0., 0., 1.])
    """
    vector = np.asarray(vector, dtype=float)
    out = np.zeros((*vector.shape, 3))
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def mirror(vectors: Array, hand: Hand = "left") -> Array:
    """Return points, forces or other vectors (..., 3) of a right hand as those of a left one, whose
    frame is x distal, y ulnar, z dorsal, and the other way round; as they are where `hand` is the
    right one.

    >>> mirror([0.01, 0.02, 0.03])
    array([ 0.01, -0.02,  0.03])
    """
    vectors = np.asarray(vectors, dtype=float)
    return vectors * [1.0, -1.0, 1.0] if hand == "left" else vectors


def mirror_axial(vectors: Array) -> Array:
    """Return axes of rotation, moments or rotation vectors (..., 3), as `mirror` does vectors: what
    turns towards a side turns towards its mirror image.

    >>> mirror_axial([0.0, 1.0, 0.0])  # flexion stays flexion
    array([-0.,  1., -0.])
    """
    return np.asarray(vectors, dtype=float) * [-1.0, 1.0, -1.0]


def rotation_matrix(vector: Array) -> Array:
    """Rotation by the vectors' length (rad) about their direction: (..., 3) -> (..., 3, 3).

    >>> quarter_turn = rotation_matrix([0.0, 0.0, math.pi / 2])
    >>> np.allclose(quarter_turn @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    True
    """
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    sinc = np.where(small, 1 - angle**2 / 6, np.sin(safe) / safe)
    cosc = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    K = skew(vector)
    return np.eye(3) + sinc * K + cosc * K @ K


def rotation_vector(matrix: Array) -> Array:
    """The inverse of `rotation_matrix` for turns below pi: (..., 3, 3) -> (..., 3) rad.

    >>> rotation_vector(rotation_matrix([0.0, 0.5, 0.0])).round(6)
    array([0. , 0.5, 0. ])
    """
    skewed = matrix - np.swapaxes(matrix, -1, -2)
    sine = skewed[..., (2, 0, 1), (1, 2, 0)] / 2
    size = np.sqrt((sine * sine).sum(axis=-1))
    cosine = (matrix[..., 0, 0] + matrix[..., 1, 1] + matrix[..., 2, 2] - 1) / 2
    if (cosine < 0).any():  # near pi the sine says little of the axis
        from scipy.spatial.transform import Rotation

        return Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_rotvec().reshape(sine.shape)
    ratio = np.divide(np.arctan2(size, cosine), size, out=np.ones_like(size), where=size > 0)
    return ratio[..., None] * sine


@dataclass(frozen=True)
class Motion:
    """Poses of the shared bodies in the world frame.

    >>> motion = Motion(("middle",), np.zeros((1, 3)), np.eye(3)[None])
    >>> motion.displace([[0.01, 0.0, 0.0, 0.0, 0.0, 0.0]]).position
    array([[0.01, 0.  , 0.  ]])

    Raises InputError for arrays of other shapes and for values that are not finite."""

    bodies: tuple[str, ...]
    position: Array
    """(nb, 3) origins, m."""
    rotation: Array
    """(nb, 3, 3) body to world."""

    def __post_init__(self) -> None:
        shape = (len(self.bodies), 3)
        if self.position.shape != shape or self.rotation.shape != (*shape, 3):
            raise InputError(
                f"motion of {len(self.bodies)} bodies {self.bodies}: expected position {shape} and "
                f"rotation {(*shape, 3)}, got {self.position.shape} and {self.rotation.shape}"
            )
        if not (np.isfinite(self.position).all() and np.isfinite(self.rotation).all()):
            raise InputError(f"motion of {self.bodies} holds a value that is not finite")

    def displace(self, twist: Array) -> Motion:
        """Poses after displacements `twist` (nb, 6): translation of the origin (m), then rotation
        vector (rad), both in the world frame."""
        twist = np.asarray(twist).reshape(-1, 6)
        return Motion(
            self.bodies,
            self.position + twist[:, :3],
            rotation_matrix(twist[:, 3:]) @ self.rotation,
        )

    def transform(self, rotation: Array, translation: Array) -> Motion:
        """Poses of the whole hand turned by `rotation` (3, 3) about the world's origin, then
        shifted by `translation` (3,) m."""
        position = self.position @ rotation.T + translation
        return Motion(self.bodies, position, rotation @ self.rotation)

    def twist_to(self, other: Motion) -> Array:
        """The twist (nb, 6) with `self.displace(twist) == other`, for rotations below pi.

        >>> motion = Motion(("middle",), np.zeros((1, 3)), np.eye(3)[None])
        >>> twist = np.array([[0.01, 0.0, 0.0, 0.0, 0.2, 0.0]])
        >>> np.allclose(motion.twist_to(motion.displace(twist)), twist)
        True
        """
        turn = rotation_vector(other.rotation @ np.swapaxes(self.rotation, 1, 2))
        return np.hstack([other.position - self.position, turn])

    def of(self, body: str) -> tuple[Array, Array]:
        """Origin (3,) m and rotation (3, 3), body to world, of one body.

        Raises ValueError for a body that is not among them."""
        i = self.bodies.index(body)
        return self.position[i], self.rotation[i]


@dataclass(frozen=True)
class Load:
    """What a hood does to each body, by source, and what the tendons do to the hood.

    >>> wrench = np.zeros((1, 2, 6))  # one body, two sources
    >>> wrench[0, :, 0] = 1.0, 2.0
    >>> load = Load(("middle",), ("slip", "contact"), wrench, pull=np.zeros((0, 6)))
    >>> load.total()
    array([[3., 0., 0., 0., 0., 0.]])

    Raises InputError for a wrench of another shape."""

    bodies: tuple[str, ...]
    sources: tuple[str, ...]
    wrench: Array
    """(nb, ns, 6) force (N) and moment about the body's origin (N m), world frame."""
    pull: Array
    """(nt, 6) force (N) of each tendon on the hood and moment about the world's origin (N m)."""

    def __post_init__(self) -> None:
        shape = (len(self.bodies), len(self.sources), 6)
        if self.wrench.shape != shape:
            raise InputError(f"load: expected wrench {shape}, got {self.wrench.shape}")

    def total(self) -> Array:
        """Force (N) and moment (N m) on each body (nb, 6), the sum over the sources."""
        return self.wrench.sum(axis=1)

    def imbalance(self, motion: Motion) -> tuple[float, float]:
        """Relative force and moment imbalance of a massless hood at the poses `motion`: pulls less
        wrenches, over the largest force and over that force times the largest distance between two
        bodies.  Both are zero where hood and tendons are in equilibrium."""
        total = self.total()
        moment = total[:, 3:] + np.cross(motion.position, total[:, :3])
        force_gap = np.linalg.norm(self.pull[:, :3].sum(0) - total[:, :3].sum(0))
        moment_gap = np.linalg.norm(self.pull[:, 3:].sum(0) - moment.sum(0))
        forces = np.vstack([self.wrench[..., :3].reshape(-1, 3), self.pull[:, :3]])
        largest = np.linalg.norm(forces, axis=1).max(initial=0.0)
        length = np.ptp(motion.position, axis=0).max(initial=0.0)
        if largest == 0.0:
            return float(force_gap), float(moment_gap)
        return float(force_gap / largest), float(moment_gap / (largest * (length or 1.0)))


class Response(NamedTuple):
    """What a hood answers to a motion and tensions."""

    state: State
    load: Load
    excursion: Array
    """(nt,) m, how far each tendon's end has moved along its pull since the hood's rest."""


@dataclass(frozen=True)
class HoodJacobian:
    """Derivatives of load and excursions at a state, by a twist per body as in `Motion.displace`
    (6 nb entries) and by the tendons' tensions."""

    load_motion: Array
    """(6 nb, 6 nb) of the bodies' wrenches by their twists."""
    load_tension: Array
    """(6 nb, nt) of the bodies' wrenches by the tensions."""
    excursion_motion: Array
    """(nt, 6 nb) of the excursions by the bodies' twists."""
    excursion_tension: Array
    """(nt, nt) m/N, of the excursions by the tensions."""


class Hood(Protocol):
    """Anything that turns poses and tensions into wrenches and excursions.

    `cosim.couple(finger, hood, tensions)` brings one into equilibrium with a finger.  A hood
    without tendons or stiffness is the least that fulfils it:

    >>> class Nothing:
    ...     bodies, tendons, sources = ("middle", "distal"), (), ("nothing",)
    ...     def start(self, motion):
    ...         return None
    ...     def advance(self, state, motion, tension, dt):
    ...         load = Load(self.bodies, self.sources, np.zeros((2, 1, 6)), np.zeros((0, 6)))
    ...         return Response(None, load, np.zeros(0))
    ...     def jacobian(self, state):
    ...         return HoodJacobian(
    ...             np.zeros((12, 12)), np.zeros((12, 0)), np.zeros((0, 12)), np.zeros((0, 0))
    ...         )
    ...     def with_tolerance(self, tolerance):
    ...         return self
    >>> hood: Hood = Nothing()
    >>> rest = Motion(hood.bodies, np.zeros((2, 3)), np.stack([np.eye(3)] * 2))
    >>> response = hood.advance(hood.start(rest), rest, np.zeros(0), STATIC)
    >>> response.load.imbalance(rest)
    (0.0, 0.0)
    """

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies on which it acts, in the order of its motions and loads."""
        ...

    @property
    def tendons(self) -> tuple[str, ...]:
        """The tendons that pull on it, in the order of its tensions and excursions."""
        ...

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources of its load, such as "pulley" or "network", in the order of its load."""
        ...

    def start(self, motion: Motion) -> State:
        """A state to begin from at the poses `motion`, which need not be the rest pose.

        Raises InputError for other bodies."""
        ...

    def advance(self, state: State, motion: Motion, tension: Array, dt: float) -> Response:
        """The response to `motion` and `tension` (nt,) N after `dt` s (`STATIC`: at rest).

        Raises InputError (wrong names or shapes) and ConvergenceError; `state` stays valid.
        """
        ...

    def jacobian(self, state: State) -> HoodJacobian:
        """Derivatives of load and excursion at a state that `advance` returned.

        A hood that has to solve first raises InputError for a state of `start`."""
        ...

    def with_tolerance(self, tolerance: float) -> Hood:
        """The same hood, free to leave a relative force residual of `tolerance`: for the first
        rounds of an iteration.  A hood in closed form is itself."""
        ...


@runtime_checkable
class StorableHood(Hood, Protocol):
    """A hood whose first answer can be kept from one process to the next."""

    def first_key(self, state: State, motion: Motion, tension: Array) -> str | None:
        """A key of all that determines the answer of `advance` from a state of `start`; None where
        that cannot be said."""
        ...

    def to_arrays(self, state: State) -> dict[str, Array]:
        """All that a state is made of, as arrays by name."""
        ...

    def from_arrays(self, arrays: Mapping[str, Array]) -> State:
        """The state of `to_arrays`.  Raises InputError where the arrays are another hood's."""
        ...

    def is_solved(self, state: State, motion: Motion, tension: Array) -> bool:
        """Whether a state of `from_arrays` is an equilibrium at `motion` under `tension` (nt,) N,
        as `advance` would leave it."""
        ...

    def response(self, state: State) -> Response:
        """What a state that `advance` returned does to the bodies."""
        ...


def check_tensions(
    who: str, tendons: tuple[str, ...], tension: Array, *, none_negative: bool = False
) -> None:
    """Check that tensions (nt,) N are one for each tendon and finite.  Raises InputError."""
    fits = np.shape(tension) == (len(tendons),) and np.isfinite(tension).all()
    if not fits or (none_negative and (np.asarray(tension) < 0).any()):
        kind = ", none negative" if none_negative else ""
        raise InputError(
            f"{who}: expected {len(tendons)} finite tensions (N){kind}, one for each of {tendons}, "
            f"got {tension!r}"
        )


def check_step(
    who: str, hood: Hood, motion: Motion, tension: Array, dt: float, *, none_negative: bool = False
) -> None:
    """Check what a hood is advanced with: its bodies, tensions as `check_tensions` takes them, a
    time step (s) that is positive.  Raises InputError."""
    if motion.bodies != hood.bodies:
        raise InputError(
            f"{who}: its bodies are {hood.bodies}, in this order; the motion has {motion.bodies}"
        )
    check_tensions(who, hood.tendons, tension, none_negative=none_negative)
    if not dt > 0:
        raise InputError(f"{who}: expected a positive time step (s), got {dt}")


@dataclass(frozen=True)
class Balance:
    """Static equilibrium of a finger under a load."""

    residual: Array
    """(n,) the equations that must vanish: joint torques (N m), then constraint gaps times
    `gap_stiffness`-like scales, so that each is a torque."""
    scale: float
    """The largest torque that enters, N m; the relative residual is that over this."""
    torque: Mapping[str, Array]
    """(nq,) N m per source: hood, each muscle, passive, limit, fingertip."""
    tip_force: Array
    """(3,) N, of the fingertip on the world, world frame; zero for a free tip."""

    @property
    def relative(self) -> float:
        """The largest residual over the scale."""
        return float(np.abs(self.residual).max(initial=0.0) / self.scale)


class Finger(Protocol):
    """A finger at rest, ours or another program's: under a load that follows its bodies it finds
    its own equilibrium."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies that it shares with a hood, in the order of its motions."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints, in the order of its angles."""
        ...

    @property
    def tendons(self) -> tuple[str, ...]:
        """Its own tendons, in the order of their tensions."""
        ...

    @property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """The angles (rad) by joint that `start` allows; infinite where nothing is known."""
        ...

    def start(self, posture: Mapping[str, float]) -> State:
        """The state at joint angles `posture` (rad) with no reaction; that tip point is held.  A
        finger with a posture of its own begins there, whatever is asked.

        Raises InputError for an unknown joint or an angle outside the joint's range."""
        ...

    def rest(self) -> Motion:
        """The poses from which the excursions of hoods count: with all joints at zero."""
        ...

    def angles(self, state: State) -> Array:
        """Joint angles (nq,) rad, in the order of `joints`."""
        ...

    def motion(self, state: State) -> Motion:
        """Poses of the shared bodies."""
        ...

    def settle(
        self, state: State, load: Load, by_motion: Array, tension: Array, tolerance: float
    ) -> tuple[State, float]:
        """The equilibrium, or a state on the way there, under its own tendons' tensions (nt,) N and
        a load that is `load` at the poses of `state` and follows the bodies with `by_motion`
        (6 nb, 6 nb); and the relative residual that is left, NaN of a finger that tells none.

        Raises ConvergenceError; `state` stays valid."""
        ...

    def balance(self, state: State, load: Load, tension: Array) -> Balance | None:
        """Equilibrium under the hood's load and the finger's own tendon tensions (N); None of a
        finger that reports no forces."""
        ...

    def between(self, state: State, aim: State, part: float) -> State:
        """The state a `part` of the way from one to another."""
        ...

    def with_angles(self, state: State, angles: Array) -> State:
        """The state with its joints at angles (nq,) rad, its reaction kept.

        Raises InputError of a finger that cannot be asked at any angles."""
        ...

    def tip(self, state: State) -> Array | None:
        """The fingertip point (3,) m, world frame, where it is known."""
        ...

    def tip_force(self, state: State) -> Array:
        """The force (3,) N of the fingertip on the world, world frame; zero for a free tip."""
        ...

    def jacobian(self, state: State) -> Array | None:
        """Twists (6 nb, nq) of the bodies per joint rate, where they are known."""
        ...

    def ledger(self, state: State, load: Load, tension: Array) -> dict[str, Array]:
        """The wrench (nb, 6) on each body about its origin, world frame, by source, as far as the
        finger tells its forces."""
        ...

    def tendon_paths(self, state: State) -> dict[str, Array]:
        """Polylines (k, 3) of the finger's own tendons, world frame, m, for pictures."""
        ...


class OpenFinger(Finger, Protocol):
    """A finger that tells its equations: a chain of rigid bodies with its own muscles, passive
    joints and fingertip support.  Its static unknowns z are the joint angles (nq) and the tip
    reaction (0 or 3)."""

    def unknowns(self, state: State) -> Array:
        """The unknowns (n,) z: the joint angles (rad), then the tip's reaction (N)."""
        ...

    def tip(self, state: State) -> Array:
        """The fingertip point (3,) m, world frame."""
        ...

    def jacobian(self, state: State) -> Array:
        """Twists (6 nb, nq) of the bodies per joint rate."""
        ...

    def balance(self, state: State, load: Load, tension: Array) -> Balance:
        """Equilibrium under the hood's load and the finger's own tendon tensions (N)."""
        ...

    def tangent(self, state: State, load: Load, tension: Array, load_motion: Array) -> Array:
        """The derivative (n, n) of the residual with respect to z, where the load follows the
        bodies with `load_motion` (6 nb, 6 nb)."""
        ...

    def displace(self, state: State, step: Array) -> State:
        """The state with its unknowns z moved by `step` (n,)."""
        ...

    def ledger(self, state: State, load: Load, tension: Array) -> dict[str, Array]:
        """The wrench (nb, 6) on each body about its origin, world frame, by source (muscles,
        passive, limit, gravity, fingertip, joint, and the ground, which holds the fixed body); with
        the hood's load they close to zero on each body."""
        ...

    def path_lengths(self, state: State) -> Array:
        """The path lengths (nt,) m of the finger's own tendons."""
        ...


class Pair(NamedTuple):
    """A finger and the hood on it."""

    finger: Finger
    hood: Hood


class PairState(NamedTuple):
    """A state of each."""

    finger: State
    hood: State


class Tensions(NamedTuple):
    """Tensions, N, of the hood's tendons and of the finger's own."""

    hood: Array
    finger: Array


@dataclass(frozen=True)
class AffineLoad:
    """What a hood does to the bodies near the poses `at`: wrench (nb, 6) about their origins at
    those poses, and its derivative (6 nb, 6 nb) by their twists; zero for a load that is held."""

    at: Motion
    wrench: Array
    by_motion: Array


class Relaxation(Protocol):
    """A relaxation function, as `fe_solver.materials.prony.Prony` is one."""

    @property
    def left(self) -> float:
        """What is left in the end of what is borne at once."""
        ...

    def start(self, borne: Array) -> Any:
        """The memory at rest of what bears (n,)."""
        ...

    def law(self, memory: Any, dt: float) -> tuple[float, Array]:
        """The factor of the elastic law `dt` s after `memory`, and what is held (n,) besides."""
        ...

    def after(self, memory: Any, borne: Array, dt: float) -> Any:
        """The memory `dt` s after one, where the law then bears (n,)."""
        ...


class MovingFinger(Protocol):
    """A finger in time.  Its state is opaque and holds angles, rates and the clock; a step may be
    repeated from the old state."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies that it shares with a hood, in the order of its motions."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints, in the order of its angles and rates."""
        ...

    @property
    def tendons(self) -> tuple[str, ...]:
        """Its own tendons, in the order of their tensions."""
        ...

    def begin(self, posture: Mapping[str, float]) -> State:
        """The state at rest at joint angles `posture` (rad by joint).

        Raises InputError for an unknown joint."""
        ...

    def angles(self, state: State) -> Array:
        """Joint angles (nq,) rad, in the order of `joints`."""
        ...

    def rates(self, state: State) -> Array:
        """Joint rates (nq,) rad/s."""
        ...

    def motion(self, angles: Array) -> Motion:
        """Poses of the shared bodies at joint angles (nq,) rad."""
        ...

    def jacobian(self, angles: Array) -> Array:
        """Twists (6 nb, nq) of the bodies per joint rate."""
        ...

    def path_lengths(self, angles: Array) -> Array:
        """The path lengths (nt,) m of the finger's own tendons at joint angles (nq,) rad."""
        ...

    def step(self, state: State, load: AffineLoad, tension: Array, dt: float) -> State:
        """The state `dt` s later under a load that follows the bodies as it says and the finger's
        own tendons' tensions (nt,) N, both at the step's end: the load is that at the new poses, so
        that schemes which agree on it agree on the step.  Raises ConvergenceError; `state` stays
        valid."""
        ...

    def energy(self, state: State) -> float:
        """The energy, J: kinetic, of height and in the finger's own springs."""
        ...
