"""Moment arms against posture: a sweep of each joint, a table, a plot, published values beside."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import ConvergenceError, Progress, quiet
from cosim.fingers.kinds import joint_ranges
from cosim.measured import RANGE, measured_of_kind
from cosim.models.build import Models
from cosim.port import STATIC, Array, Load, Motion, State
from cosim.results.looks import Look, look
from cosim.results.picture import new_picture
from cosim.tendons.friction import without_friction

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACTION = 5e-5
"""m: a tendon that nowhere reaches this arm does not act on a joint."""
MEAN_OF = 19
"""Postures in a mean over a range."""
MOST_STEP = float(np.radians(10.0))
"""A hood follows the bones in steps of at most this turn."""
SAME_POSTURE = float(np.radians(1.0))
"""Joints that stand no further apart are in the same posture."""


def sweep(
    models: Models,
    tension: Array,
    ranges: Mapping[str, tuple[float, float]],
    steps: int,
    progress: Progress = quiet,
) -> tuple[pandas.DataFrame, list[str]]:
    """Moment arms in mm (flexion and radial abduction positive) while each joint passes its range
    (rad) in `steps` postures and the others keep the case's; and where the hood could not follow.

    Columns: joint, angle_deg, tendon, arm_mm.  A hood's arms are d torque / d tension at fixed pose
    under the tensions `tension` (N); the finger's own are the shortening of the path per rad."""
    import pandas

    rows, lost = [], []
    for joint, bounds in ranges.items():
        j = models.finger.joints.index(joint)
        angles = np.linspace(*bounds, steps)
        native = _native_arms_over(models, joint, angles)
        pulled, why = _hood(models, tension, joint, angles, progress)
        lost += why
        for k, angle in enumerate(np.degrees(angles)):
            for tendon, arm in {**pulled.get(k, {}), **native[k]}.items():
                rows.append((joint, float(angle), tendon, 1e3 * arm[j]))
    return pandas.DataFrame(rows, columns=["joint", "angle_deg", "tendon", "arm_mm"]), lost


def native_arms(models: Models, posture: Mapping[str, float]) -> dict[str, Array]:
    """Moment arms (nq,) m of the finger's own tendons at joint angles `posture` (rad), which no
    friction changes."""
    finger = without_friction(models.finger)
    bodies, names = finger.bodies, finger.tendons
    idle = Load(bodies, ("hood",), np.zeros((len(bodies), 1, 6)), np.zeros((0, 6)))
    torque = finger.balance(finger.start(posture), idle, np.ones(len(names))).torque
    return {name: torque[name] for name in names}


def _native_arms_over(models: Models, joint: str, angles: Array) -> list[dict[str, Array]]:
    return [native_arms(models, {**models.posture, joint: float(angle)}) for angle in angles]


def _hood(
    models: Models, tension: Array, joint: str, angles: Array, progress: Progress
) -> tuple[dict[int, dict[str, Array]], list[str]]:
    """Arms of the hood's tendons by the number of the angle, from the case's posture outwards to
    either side, so that the hood follows the bones; and where it could not."""
    if not models.hood.tendons:
        return {}, []
    home = models.posture.get(joint, 0.0)
    out: dict[int, dict[str, Array]] = {}
    lost = []
    for side in (np.flatnonzero(angles >= home), np.flatnonzero(angles < home)[::-1]):
        at, state = home, models.hood.start(_motion(models, joint, home))
        try:
            for k in side:
                pieces = max(1, int(np.ceil(abs(angles[k] - at) / MOST_STEP)))
                for angle in np.linspace(at, angles[k], 1 + pieces)[1:]:
                    motion = _motion(models, joint, angle)
                    state = models.hood.advance(state, motion, tension, STATIC).state
                at = angles[k]
                progress(f"{joint} {np.degrees(at):.0f} deg, {len(out) + 1}/{len(angles)}")
                out[int(k)] = _with_tension(models, joint, at, state)
        except ConvergenceError as error:
            beyond = f"from {np.degrees(at):.0f} towards {np.degrees(angles[side[-1]]):.0f} deg"
            lost.append(f"{joint} {beyond}: {error}")
    return out, lost


def _motion(models: Models, joint: str, angle: float) -> Motion:
    return models.finger.motion(models.finger.start({**models.posture, joint: float(angle)}))


def _with_tension(models: Models, joint: str, angle: float, state: State) -> dict[str, Array]:
    finger = models.finger
    jacobian = finger.jacobian(finger.start({**models.posture, joint: float(angle)}))
    arms = jacobian.T @ models.hood.jacobian(state).load_tension
    return dict(zip(models.hood.tendons, arms.T, strict=True))


def published_arms(finger: str) -> pandas.DataFrame:
    """Columns tendon, joint, posture_deg, arm_mm, source: what is in print of a kind of finger, the
    measured ones of the collection first, then those of models; no row where nothing is."""
    import pandas

    measured = [
        (m.muscle, m.joint, m.posture, m.number(), m.cited.cited)
        for m in measured_of_kind("arm", finger=finger)
        if m.value is not None and (m.angles is not None or m.posture == RANGE)
    ]
    path = resources.files("cases") / "data" / "moment_arms.csv"
    every = pandas.read_csv(str(path), comment="#").drop(columns="evidence")
    models = every[every.finger == finger].drop(columns="finger")
    first = pandas.DataFrame(measured, columns=models.columns)
    return pandas.concat([first, models] if measured else [models], ignore_index=True)


def compare_published(models: Models, known: pandas.DataFrame) -> pandas.DataFrame:
    """Published arms (as of `published_arms`) beside those of the finger's own tendons in the
    source's posture, or, where the source averages over a range, beside the mean from the straight
    joint to its full flexion in the case's posture of the others."""
    in_finger = known.tendon.isin(models.finger.tendons) & known.joint.isin(models.finger.joints)
    known = known[in_finger].copy()
    known["model_mm"] = [
        1e3 * _arm(models, row.tendon, row.joint, row.posture_deg) for row in known.itertuples()
    ]
    return known


def by_posture(compared: pandas.DataFrame) -> dict[str, pandas.DataFrame]:
    """By joint, the arms of `compare_published` in mm: a row for each tendon and who says it, the
    model first, a column for each posture."""
    import pandas

    ours = compared.assign(source="model", arm_mm=compared.model_mm)
    ours = ours.drop_duplicates(["joint", "tendon", "posture_deg"])
    out = {}
    for joint in dict.fromkeys(compared.joint):
        parts = [table[table.joint == joint] for table in (ours, compared)]
        tendons, postures, sources = (
            list(dict.fromkeys([*parts[0][name], *parts[1][name]]))
            for name in ("tendon", "posture_deg", "source")
        )
        wide = pandas.concat(parts).pivot(
            index=["tendon", "source"], columns="posture_deg", values="arm_mm"
        )
        rows = [(t, s) for t in tendons for s in sources if (t, s) in wide.index]
        out[str(joint)] = wide.loc[rows, sorted(postures, key=_flexion)]
    return out


def _flexion(posture: str) -> tuple[bool, tuple[float, ...]]:
    """For an order of postures: a range last."""
    ranged = posture == "range"
    return ranged, () if ranged else tuple(float(part) for part in posture.split("/"))


def _arm(models: Models, tendon: str, joint: str, posture: str) -> float:
    j = models.finger.joints.index(joint)
    if posture != "range":
        return float(native_arms(models, _posture(posture))[tendon][j])
    flexion = np.linspace(0.0, joint_ranges(models.finger)[joint][1], MEAN_OF)
    return float(np.mean([arms[tendon][j] for arms in _native_arms_over(models, joint, flexion)]))


def _posture(text: str) -> dict[str, float]:
    angles = (float(np.radians(float(part))) for part in text.split("/"))
    return dict(zip(("MCP", "PIP", "DIP"), angles, strict=True))


def draw(
    table: pandas.DataFrame,
    title: str,
    known: pandas.DataFrame,
    posture: Mapping[str, float],
) -> Figure:
    """A panel for each joint: arm against angle, a line for each tendon; of the published arms
    `known` (as of `published_arms`) a dotted line where the source averages over the flexion,
    and a point where its other joints stand as in `posture` (rad), in which the sweep leaves
    them."""
    from matplotlib.lines import Line2D

    joints = list(dict.fromkeys(table.joint))
    tendons = list(dict.fromkeys(table.tendon))
    looks = {tendon: look(i) for i, tendon in enumerate(tendons)}
    figure = new_picture(max(6.0, 4.2 * len(joints)), 4.6)
    panels = figure.subplots(1, len(joints), squeeze=False).ravel()
    for axes, joint in zip(panels, joints, strict=True):
        of_joint = table[table.joint == joint]
        for tendon, line in of_joint.groupby("tendon", sort=False):
            if not line.arm_mm.abs().max() < 1e3 * ACTION:
                axes.plot(line.angle_deg, line.arm_mm, **looks[str(tendon)].line)
        seen = known[(known.joint == joint) & known.tendon.isin(tendons)]
        _draw_known(axes, seen, looks, posture, float(of_joint.angle_deg.max()))
        axes.axhline(0.0, color="0.7", lw=0.8, zorder=0)
        axes.set(title=joint.replace("_", " "), xlabel="angle, deg")
        axes.grid(alpha=0.3)
    lines = [Line2D([], [], label=tendon, **looks[tendon].line) for tendon in tendons]
    figure.legend(handles=lines, loc="outside right center", handlelength=3)
    figure.axes[0].set_ylabel("moment arm, mm (flexion, radial abduction positive)")
    shown = "" if known.empty else " (dotted: published means, points: published values)"
    figure.suptitle(f"{title}: moment arms{shown}", fontsize=11)
    return figure


def _draw_known(
    axes: Axes,
    known: pandas.DataFrame,
    looks: Mapping[str, Look],
    posture: Mapping[str, float],
    most_flexed: float,
) -> None:
    """Published arms about one joint; most_flexed: deg, the end of a mean's range."""
    for row in known.itertuples():
        tendon = looks[str(row.tendon)].colour
        if row.posture_deg == "range":
            axes.hlines(row.arm_mm, 0.0, most_flexed, color=tendon, lw=1, ls=":")
            continue
        stands = {"MCP_abduction": 0.0, **_posture(str(row.posture_deg))}
        angle = np.degrees(stands.pop(str(row.joint)))
        if all(abs(rad - posture.get(joint, 0.0)) < SAME_POSTURE for joint, rad in stands.items()):
            axes.plot(angle, row.arm_mm, "o", color=tendon, ms=4)
