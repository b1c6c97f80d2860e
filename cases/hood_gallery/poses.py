"""A sheet hood solved over many postures of held bones, each from the equilibrium before it.

At a posture (MCP, PIP, DIP; deg) the hood is solved at rest, every tendon at the case's resting
tension, and from there under each pull, tensions in N of some tendons in place of the resting one.
Where no equilibrium is found another way is tried: at rest from the hood as it was laid, under a
pull from the last posture under the same pull.  A pose without equilibrium stays in the results,
with its reason and without numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from cosim.case.schema import Case
from cosim.errors import ConvergenceError, Progress, quiet
from cosim.hoods.fe_view import FeView
from cosim.hoods.lesion import apply_lesion_to_mesh
from cosim.models.build import Models, build, hood_mesh
from cosim.outcome import one_line
from cosim.port import STATIC, Array, Response, State
from cosim.results.audit import missed_bounds
from cosim.results.conventions import is_slack
from meshes.bands import sagittal_angles, sagittal_bands

Posture = tuple[float, float, float]
"""deg of MCP, PIP and DIP; no abduction."""
Pull = tuple[tuple[str, float], ...]
"""N by tendon; the others have the resting tension."""
JOINTS = ("MCP", "PIP", "DIP")
REST: Pull = ()
CONVERGED = "equilibrium"


@dataclass(frozen=True)
class SolvedPose:
    """A hood in a posture under a pull."""

    posture: Posture
    pull: Pull
    way: str
    """"flexion", or "extension" where the hood came from a more flexed posture."""
    status: str
    """CONVERGED, or what is wrong: a missed audit or no equilibrium, with its reason."""
    numbers: Mapping[str, float]
    """By name with its unit; empty without equilibrium.  Torques and moment arms (d torque /
    d tension) flex where they are positive; excursions are positive proximally, from where the
    hood was laid."""

    @property
    def converged(self) -> bool:
        """Whether there is an equilibrium, though its audit may be missed."""
        return bool(self.numbers)

    @property
    def name(self) -> str:
        """Posture and pull in words."""
        return f"{posture_name(self.posture)}, {pull_name(self.pull)}"

    def row(self) -> dict[str, object]:
        """The pose in a table: angles, load, numbers and status."""
        angles = {f"{joint}_deg": a for joint, a in zip(JOINTS, self.posture, strict=True)}
        where = {**angles, "load": pull_name(self.pull), "way": self.way}
        return {**where, **self.numbers, "status": self.status}


def posture_name(posture: Posture) -> str:
    """MCP/PIP/DIP in deg, as in "0/45/15"."""
    return "/".join(f"{angle:g}" for angle in posture)


def pull_name(pull: Pull) -> str:
    """ "rest", "EDC 3 N"; "all 1 N" of two or more tendons with the same tension."""
    tensions = {tension for _, tension in pull}
    if len(pull) > 1 and len(tensions) == 1:
        return f"all {tensions.pop():g} N"
    return ", ".join(f"{tendon} {tension:g} N" for tendon, tension in pull) or "rest"


@dataclass
class HoodPoses:
    """The hood of a case, its state in the last posture, and what was solved so far."""

    case: Case
    say: Progress = quiet
    """Called with each pose in words."""
    models: Models = field(init=False)
    known: dict[tuple[Posture, Pull, str], SolvedPose] = field(init=False, default_factory=dict)
    _last: dict[Pull, State] = field(init=False, default_factory=dict)
    """The state in the last posture with equilibrium, by pull."""

    def __post_init__(self) -> None:
        """Build the hood.  Raises InputError for a case without a sheet."""
        mesh = apply_lesion_to_mesh(hood_mesh(self.case), self.case.lesion)
        self.models = build(self.case)
        self._sagittal = sagittal_bands(mesh)

    @property
    def tendons(self) -> tuple[str, ...]:
        """The names of the hood's tendons."""
        return self.models.hood.tendons

    def walk(
        self, name: str, postures: Sequence[tuple[Posture, str]], pulls: Sequence[Pull]
    ) -> list[SolvedPose]:
        """Solve the hood in each posture (with its way) at rest and under each pull, those from
        the lightest on; `name` is for progress."""
        out: list[SolvedPose] = []
        total = len(postures) * (1 + len(pulls))
        for posture, way in postures:
            for pose in self._posture(posture, way, pulls):
                out.append(pose)
                ended = "" if pose.status == CONVERGED else f": {pose.status}"
                self.say(f"{name}: {len(out)} of {total}, {pose.name}{ended}")
        return out

    def _posture(self, posture: Posture, way: str, pulls: Sequence[Pull]) -> Iterator[SolvedPose]:
        keys = [(posture, pull, way) for pull in (REST, *pulls)]
        if all(key in self.known for key in keys):
            yield from (self.known[key] for key in keys)
            return
        last_state = self._last.get(REST)
        for key in keys:
            pose, state = self._solve(*key, last_state)
            if state is not None:
                last_state = self._last[key[1]] = state
            self.known[key] = pose
            yield pose

    def _solve(
        self, posture: Posture, pull: Pull, way: str, last_state: State
    ) -> tuple[SolvedPose, State]:
        """The pose, and the hood's state in it, None without equilibrium."""
        finger, hood = self.models.finger, self.models.hood
        at = finger.start(dict(zip(JOINTS, np.radians(posture), strict=True)))
        motion, tension = finger.motion(at), self._tension(pull)
        starts = [last_state, self._last.get(pull) if pull else hood.start(motion)]
        reason = "nothing to begin from"
        for start in (state for state in starts if state is not None):
            try:
                response = hood.advance(start, motion, tension, STATIC)
            except ConvergenceError as error:
                reason = one_line(error)
                continue
            numbers, missed = self._numbers(at, response)
            status = f"audit missed: {', '.join(missed)}" if missed else CONVERGED
            return SolvedPose(posture, pull, way, status, numbers), response.state
        return SolvedPose(posture, pull, way, f"no equilibrium: {reason}", {}), None

    def _tension(self, pull: Pull) -> Array:
        out = np.full(len(self.tendons), self.models.resting)
        for tendon, tension in pull:
            out[self.tendons.index(tendon)] = tension
        return out

    def _numbers(self, at: State, response: Response) -> tuple[dict[str, float], list[str]]:
        """Numbers by name, and what the audit misses."""
        models = self.models
        state, load, excursion = response
        finger, c = models.finger, state.configuration
        assert models.built.view is not None
        assert models.built.slips is not None
        # of a sheet, as __post_init__ has seen
        view, slips = cast(FeView, models.built.view(state)), models.built.slips(state)
        jacobian = finger.jacobian(at)
        torque = 1e3 * (jacobian.T @ load.total().ravel())
        arms = 1e3 * (jacobian.T @ models.hood.jacobian(state).load_tension)
        rows = [finger.joints.index(joint) for joint in JOINTS]
        out = {f"torque_{j}_Nmm": float(torque[i]) for i, j in zip(rows, JOINTS, strict=True)}
        out |= {f"{slip}_slip_N": force for slip, force in slips.items()}
        if not is_slack(slips, "central"):
            out["slip_ratio"] = slips["terminal"] / slips["central"]
        for k, tendon in enumerate(self.tendons):
            out[f"{tendon}_excursion_mm"] = 1e3 * float(excursion[k])
            for i, joint in zip(rows, JOINTS, strict=True):
                out[f"{tendon}_{joint}_arm_mm"] = float(arms[i, k])
        out |= {f"glide_{place}_mm": 1e3 * way for place, way in view.glide.items()}
        out |= {f"lateral_band_height_{s}_mm": 1e3 * z for s, z in view.band_height.items()}
        if self._sagittal is not None:
            angles = sagittal_angles(self._sagittal, c.x, c.position, c.rotation)
            for side, lines in angles.items():
                for line, angle in lines.items():
                    out[f"sagittal_{side}_{line}_deg"] = float(np.degrees(angle))
        force, moment = load.imbalance(finger.motion(at))
        audit = {
            "hood_residual": state.solution.residual,
            "hood_force_balance": force,
            "hood_moment_balance": moment,
            **view.pressed(),
        }
        return out | audit, missed_bounds(audit)
