# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A hood of your own behind the port
#
# A hood is anything that turns the poses of the bones and the tensions of its tendons into wrenches
# on the bones and excursions: `cosim.port.Hood`. Here it is one inextensible strand from a muscle
# over the PIP to the middle phalanx. No case file is needed for it, and no class to inherit from.

# %%
import matplotlib.pyplot as plt
import numpy as np

import cosim
from cosim.port import HoodJacobian, Load, Response

POINTS = (
    ("metacarpal", (0.000, 0.0, 0.009)),
    ("proximal", (0.009, 0.0, 0.008)),
    ("proximal", (0.042, 0.0, 0.005)),
    ("middle", (0.006, 0.0, 0.005)),
)  # m, in the frames of the bones: x distal, y radial, z dorsal


class OneStrand:
    """A strand through points that are fixed to the bones, without friction."""

    bodies = ("metacarpal", "proximal", "middle", "distal")
    tendons = ("EDC",)
    sources = ("strand",)

    def start(self, motion):
        """There is nothing to remember: the state is what the last answer was asked for."""
        return motion, np.zeros(1)

    def points(self, motion):
        """(4, 3) m in the world."""
        places = (motion.of(body) for body, _ in POINTS)
        local = (np.array(point) for _, point in POINTS)
        return np.array([o + R @ p for (o, R), p in zip(places, local, strict=True)])

    def answer(self, motion, tension):
        """The load on the bones, and how far the muscle's end has moved proximally (m)."""
        points = self.points(motion)
        spans = np.diff(points, axis=0)
        lengths = np.linalg.norm(spans, axis=1)
        along = spans / lengths[:, None]
        force = np.zeros((4, 3))
        force[1:-1] = tension * (along[1:] - along[:-1])
        force[-1] = -tension * along[-1]
        wrench = np.zeros((len(self.bodies), 1, 6))
        for (body, _), point, push in zip(POINTS, points, force, strict=True):
            b = self.bodies.index(body)
            wrench[b, 0] += [*push, *np.cross(point - motion.position[b], push)]
        pull = -tension * along[0]  # of the muscle on the strand, in line with its first span
        pulls = np.array([[*pull, *np.cross(points[0], pull)]])
        return Load(self.bodies, self.sources, wrench, pulls), np.array([-lengths.sum()])

    def advance(self, state, motion, tension, dt):
        load, excursion = self.answer(motion, float(tension[0]))
        return Response((motion, tension), load, excursion)

    def jacobian(self, state):
        """By central differences; a hood with a tangent of its own returns that."""
        motion, tension = state
        pull, step = float(tension[0]), 1e-6
        columns, slopes = [], []
        for k in range(6 * len(self.bodies)):
            twist = np.zeros(6 * len(self.bodies))
            twist[k] = step
            plus, minus = (
                self.answer(motion.displace(sign * twist.reshape(-1, 6)), pull) for sign in (1, -1)
            )
            columns.append((plus[0].total() - minus[0].total()).ravel() / (2 * step))
            slopes.append((plus[1] - minus[1]) / (2 * step))
        by_tension = self.answer(motion, 1.0)[0].total().reshape(-1, 1)
        return HoodJacobian(np.array(columns).T, by_tension, np.array(slopes).T, np.zeros((1, 1)))

    def with_tolerance(self, tolerance):
        """A hood in closed form is as exact as it can be."""
        return self


# %% [markdown]
# `couple` brings it into equilibrium with the finger of a case, whose fingertip is held.

# %%
finger = cosim.load("pulley_edc")
found = cosim.couple(finger, OneStrand(), {"EDC": 3.0}, resting=0.05)
found.interface_residual

# %% [markdown]
# The strand is massless: what the muscle pulls is what the bones bear.

# %%
force, moment = found.load.imbalance(found.motion)
assert force < 1e-12
assert moment < 1e-12
{name: 1e3 * torque for name, torque in found.known_balance.torque.items() if name == "hood"}

# %% [markdown]
# Virtual work: on the bones that move, the excursion follows the pose as the load follows the
# tension. (The muscle itself is fixed to the metacarpal.)

# %%
by_pose, by_tension = found.jacobian.excursion_motion, found.jacobian.load_tension
assert np.allclose(by_pose[:, 6:], by_tension[6:].T, atol=1e-8)

# %% [markdown]
# The force of the fingertip for a muscle that pulls harder and harder, beside that of the case's
# own hood, which also reaches the distal phalanx.

# %%
pulls = np.linspace(0.5, 5.0, 10)
hoods = {"one strand": OneStrand(), "cable over pulleys": finger}
figure, axes = plt.subplots(layout="constrained")
for name, hood in hoods.items():
    solved = [cosim.couple(finger, hood, {"EDC": pull}, resting=0.05) for pull in pulls]
    axes.plot(pulls, [s.tip_force["dorsal"] for s in solved], "o-", label=name)
axes.set(xlabel="tension of EDC, N", ylabel="dorsal force of the fingertip, N")
axes.legend()
plt.show()
