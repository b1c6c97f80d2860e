"""The stretches of a job's time in which the same conditions are in force.

A step of a FEBio file may have conditions of its own, which FEBio sets and releases at once at its
begin.  Here a job goes on from the last equilibrium over the first increment of that step: what is
released acts on as a load that falls to zero, what is set is brought from where it is to where the
condition has it, and a contact that presses at once comes in.  At the ends of increments that is
the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.port import Array, rotation_vector
from fe_solver.job.curves import Curve, Drive, LoadCurve, sum_of
from fe_solver.job.job import Job
from fe_solver.solver.continuation import SAME_TIME
from fe_solver.supports import Body, Given


@dataclass(frozen=True)
class Phase:
    """Steps of a job, one after the other, with the same conditions."""

    job: Job
    """With these conditions alone."""
    begin: float
    """s."""
    end: float
    """s; of the last phase, infinite."""
    risen: float
    """s, the end of its first increment."""
    pairs: tuple[int, ...]
    """The numbers of its contact pairs among those of the whole job."""
    stays: tuple[tuple[bool, ...] | None, ...]
    """Which of the six motions of each body stay where they are at the begin; None where its
    motions are those of all steps."""

    @property
    def fade(self) -> Curve:
        """What falls from one at the begin to zero at the end of the first increment."""
        return LoadCurve((self.begin, self.risen), (1.0, 0.0))

    def marks(self, marks: Sequence[float]) -> list[float]:
        """Those of the times at which a solve stops that are within the phase; and the end of its
        first increment, where it is not the first phase."""
        own = self.within(marks)
        if self.begin > 0 and own and own[0] > self.risen * (1 + SAME_TIME):
            own = [self.risen, *own]
        return own

    def within(self, times: Sequence[float]) -> list[float]:
        """The times within the phase, its end with it."""
        low, high = self.begin * (1 + SAME_TIME), self.end * (1 + SAME_TIME)
        return [t for t in times if low < t <= high]

    def bodies(self, position: Array, rotation: Array) -> tuple[Body, ...]:
        """The bodies, which are at `position` (nb, 3) m and `rotation` (nb, 3, 3) at the begin:
        their drives begin there, and take over in the first increment where they say otherwise."""
        poses = zip(self.job.bodies, position, rotation, self.stays, strict=True)
        return tuple(b if stays is None else self._body(b, p, r, stays) for b, p, r, stays in poses)

    def _body(self, body: Body, position: Array, rotation: Array, stays: tuple[bool, ...]) -> Body:
        driven = np.array([d.at(self.begin) for d in body.rotation])
        now = np.concatenate([position - body.origin, _nearest_turn(rotation, driven)])
        drives = []
        for drive, at, is_free, stay in zip(
            (*body.displacement, *body.rotation), now.tolist(), body.free, stays, strict=True
        ):
            off = at - drive.at(self.begin)
            if is_free or stay:
                drives.append(Drive(at))
            elif off:
                drives.append(sum_of([drive, Drive(off, self.fade)]))
            else:
                drives.append(drive)
        x, y, z, u, v, w = drives
        return replace(body, displacement=(x, y, z), rotation=(u, v, w))


def _nearest_turn(rotation: Array, driven: Array) -> Array:
    """The rotation vector (3,) rad of a rotation (3, 3), of those that differ by whole turns the
    one nearest to `driven` (3,)."""
    vector = rotation_vector(rotation)
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return vector
    turns = round(float((driven - vector) @ vector) / angle / (2 * np.pi))
    return np.asarray(vector * (1 + 2 * np.pi * turns / angle))


def phases(job: Job) -> list[Phase]:
    """The phases of a job, one after the other."""
    if not job.steps:
        pairs, stays = tuple(range(len(job.contacts))), (None,) * len(job.bodies)
        return [Phase(job, 0.0, np.inf, 0.0, pairs, stays)]
    out: list[Phase] = []
    begins = [0.0, *(s.end for s in job.steps)]
    keys = [_conditions(job, i) for i in range(len(job.steps))]
    for i, (begin, step) in enumerate(zip(begins, job.steps, strict=False)):
        if i and keys[i] == keys[i - 1]:
            out[-1] = replace(out[-1], end=step.end)
            continue
        risen = begin + (step.end - begin) / step.increments
        active = (k for k, c in enumerate(job.contacts) if c.steps is None or i in c.steps)
        moving = tuple(
            tuple(m is Given.STAYS for m in b.motions[i]) if b.motions else None for b in job.bodies
        )
        out.append(Phase(job.during(i), begin, step.end, risen, tuple(active), moving))
    out[-1] = replace(out[-1], end=np.inf)
    return out


def _conditions(job: Job, step: int) -> tuple[object, ...]:
    """What tells the conditions of a step from those of another."""
    lists = (job.ties, job.held, job.held_directors, job.contacts)
    steps = [c.steps for conditions in lists for c in conditions]
    in_force = tuple(own is None or step in own for own in steps)
    return in_force, tuple(b.motions[step] for b in job.bodies if b.motions)
