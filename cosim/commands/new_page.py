"""What the page of `cosim new` shows of a finger of a user's own bones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas

from cosim.analyses.moment_arms import published_arms
from cosim.anatomy.own_case import OwnCase, OwnFinger
from cosim.case.file import load_case
from cosim.errors import ConvergenceError, Progress
from cosim.files import write_text
from cosim.models.build import bone_surfaces, hood_mesh
from cosim.pipeline import run_case
from cosim.report.anatomy_page import Drawn, draw_anatomy
from cosim.report.templates import html_page
from cosim.results.picture import picture_address
from cosim.results.result import Result
from cosim.results.table import ReportTable
from meshes.skeleton import BODIES, JOINTS

POSTURES = ("0/0/0", "30/45/15", "60/0/0")
"""MCP/PIP/DIP, deg: those in which the most arms are published."""
HELD = ('finger.tip.kind="posture"', "finger.posture.MCP_abduction=0 deg", "output.picture=false")
SHOWN = 1
"""The posture of the picture."""
LEAST_ARM = 0.05
"""mm, of an arm that is listed."""


def write_page(own: OwnCase, progress: Progress) -> tuple[Path, str]:
    """Write the page beside a case, and say what it could not show.  Raises InputError."""
    runs, lost = _runs(own.case, progress)
    ours, _ = _runs(Path(own.finger.template.base), progress)
    shown = runs[SHOWN]
    picture = None if shown is None else shown.plot()
    path = own.case.with_suffix(".html")
    rows = {
        "bones": _bone_rows(own.finger),
        "joints": _joint_rows(own.finger),
        "arms": _arm_rows(own.finger.template.kind, runs, ours),
        "sources": _source_rows(own),
    }
    page = html_page(
        "anatomy.html.j2",
        title=f"{own.case.stem}: our hood on your bones",
        drawing=picture_address(draw_anatomy(_drawn(own)), 110),
        run=picture_address(picture, 90),
        run_words=f"The hood over held bones at {POSTURES[SHOWN]} deg, its tendons at rest.",
        tables={key: ReportTable(key, key, head, each) for key, (head, *each) in rows.items()},
        report=own.report,
    )
    write_text(path, page)
    return path, "".join(f"; {posture}: {why}" for posture, why in lost.items())


def _runs(case: Path, progress: Progress) -> tuple[list[Result | None], dict[str, str]]:
    """The hood at rest over bones held in each posture; where it found no equilibrium."""
    runs: list[Result | None] = []
    lost = {}
    for posture in POSTURES:
        progress(f"{case.stem}: moment arms at {posture} deg")
        angles = zip(("MCP", "PIP", "DIP"), posture.split("/"), strict=True)
        held = [*HELD, *(f"finger.posture.{joint}={angle} deg" for joint, angle in angles)]
        try:
            runs.append(run_case(load_case(case, held)))
        except ConvergenceError as error:
            runs.append(None)
            lost[posture] = str(error)
    return runs, lost


def _drawn(own: OwnCase) -> Drawn:
    finger, case = own.finger, load_case(own.case)
    skeleton = finger.joints.skeleton
    position, rotation = skeleton.pose({})
    place = {b: (position[i], rotation[i]) for i, b in enumerate(BODIES)}

    def world(body: str, points: np.ndarray) -> np.ndarray:
        origin, axes = place[body]
        return np.asarray(origin + np.atleast_2d(points) @ axes.T)

    bones = {b: (world(b, points), faces) for b, (points, faces) in bone_surfaces(case).items()}
    points = {
        tendon: np.vstack([world(body, np.array(point)) for body, point in passed])
        for tendon, passed in finger.tendon_points().items()
    }
    moved = {"MCP": 1, "MCP_abduction": 1, "PIP": 2, "DIP": 3}
    axes = {
        joint: (position[moved[joint]], rotation[moved[joint]] @ axis)
        for joint, axis in zip(JOINTS, skeleton.axis, strict=True)
    }
    eyelets = {t: np.array([x, z, y]) for t, (x, y, z) in finger.eyelets.items()}
    mesh = hood_mesh(case)
    return Drawn(bones, points, eyelets, axes, mesh.points[mesh.quads[:, :4]])


def _bone_rows(finger: OwnFinger) -> list[list[str]]:
    header = ["bone", "length", "width", "depth", "similarity", "affine", "spline", "other way"]
    rows = [[*header[:4], *(f"{name}, mm: mean (95 %)" for name in header[4:7]), header[7]]]
    for body in BODIES:
        fit = finger.laid.fits[body]
        size = [f"{part:.3f}" for part in fit.stretch]
        if body not in finger.laid.given:
            rows.append([f"{body} (ours, scaled)", *size, "–", "–", "–", "–"])
            continue
        gaps = [f"{1e3 * mean:.3f} ({1e3 * most:.3f})" for mean, most in fit.distance.values()]
        rows.append([body, *size, *gaps, f"{fit.flipped:.1f} times worse"])
    return rows


def _joint_rows(finger: OwnFinger) -> list[list[str]]:
    rows = [["joint", "shape at the head", "against the carried joint", "axis", "ours"]]
    shown = {head.joint: head for head in finger.heads.values()}
    user, ours = finger.joints.skeleton, finger.template.skeleton
    for joint, axis, our in zip(JOINTS, user.axis, ours.axis, strict=True):
        head = shown.get(joint)
        shape = off = "–"
        if head is not None:
            kind = "sphere" if joint == "MCP" else "cylinder"
            shape = f"{kind} of {1e3 * head.radius:.2f} mm (rms {1e3 * head.rms:.2f})"
            off = f"{head.angle:.1f} deg, {1e3 * head.shift:.2f} mm"
        rows.append([joint, shape, off, *(" ".join(f"{n:+.3f}" for n in v) for v in (axis, our))])
    for body, mine, our in zip(BODIES[1:], user.length[1:], ours.length[1:], strict=True):
        size = f"{1e3 * mine:.2f} mm from joint to joint"
        rows.append([f"{body} phalanx", size, "–", "–", f"{1e3 * our:.2f} mm"])
    return rows


def _arm_rows(
    kind: str, runs: Sequence[Result | None], ours: Sequence[Result | None]
) -> list[list[str]]:
    rows = [["tendon, joint", *(f"{p}: yours (ours); published" for p in POSTURES), "over a range"]]
    known = published_arms(kind)
    first = next(run for run in runs if run is not None)
    for tendon, arms in first.summary["moment_arm_mm"].items():
        for joint in arms:
            of_joint = known[(known.tendon == tendon) & (known.joint == joint)]
            cells = [
                _arm(mine, our, tendon, joint, of_joint[of_joint.posture_deg == posture])
                for posture, mine, our in zip(POSTURES, runs, ours, strict=True)
            ]
            if any(cells):
                ranged = _published(of_joint[of_joint.posture_deg == "range"])
                rows.append([f"{tendon}, {joint.replace('_', ' ')}", *cells, ranged])
    return rows


def _arm(
    mine: Result | None, ours: Result | None, tendon: str, joint: str, known: pandas.DataFrame
) -> str:
    values = [
        None if run is None else float(run.summary["moment_arm_mm"][tendon][joint])
        for run in (mine, ours)
    ]
    if all(value is None or abs(value) < LEAST_ARM for value in values):
        return ""
    yours, our = ("–" if value is None else f"{value:.2f}" for value in values)
    published = _published(known)
    return f"{yours} ({our})" + (f"; {published}" if published else "")


def _published(known: pandas.DataFrame) -> str:
    return ", ".join(
        f"{row.arm_mm:.2f} {str(row.source).split(',')[0]}" for row in known.itertuples()
    )


def _source_rows(own: OwnCase) -> list[list[str]]:
    """What was measured on the bones, carried over by them, and assumed."""
    finger = own.finger
    given = ", ".join(finger.laid.given)
    lacking = [body for body in BODIES if body not in finger.laid.given]
    tendons = ", ".join(finger.model.muscles)
    fitted = ", ".join(head.joint for head in finger.heads.values()) or "none"
    solves, found = own.slips.solves, "found" if own.slips.is_met else "not met"
    rows = [
        ["what", "how", "from"],
        [f"surfaces of {given}", "measured", "your files"],
        [f"joint centres of {fitted}", "measured", "heads of the bones, by what ours differ in"],
        ["axis of the PIP", "measured" if "proximal" in finger.heads else "carried", "its head"],
        ["axis of the DIP", "carried", "keeps to the PIP's what ours keeps"],
        ["axes of the MCP", "carried", "the proximal phalanx, where no landmark states them"],
        ["fingertip", "carried", "the distal phalanx"],
        [f"points of {tendons}", "carried", "thin-plate spline on the bone, our height off it"],
        [f"eyelets of {', '.join(finger.eyelets)}", "carried", "the metacarpal"],
        ["hood", "laid", "the generator, over your surfaces"],
        ["length of the central slip", found, f"the slips' shares of a pull, {solves} solves"],
        ["springs' slack and toe", "scaled", f"{finger.size:.3f}, the phalanges' length over ours"],
        ["height of soft tissue, sections, moduli, strengths", "assumed", finger.template.base],
    ]
    rows += [[f"the {body}", "assumed", "ours, scaled as the others"] for body in lacking]
    stated = [f"{name} of the {bone}" for bone, name in finger.laid.stated]
    return rows + ([[", ".join(stated), "stated", "your landmarks"]] if stated else [])
