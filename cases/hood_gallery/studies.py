"""What `python -m cases.hood_gallery` shows of a hood over postures: five studies."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pandas as pd

from cases.hood_gallery import plots as pictures
from cases.hood_gallery.literature import (
    AN_HEIGHT,
    COUPLINGS,
    LEAST_SHARE,
    LEE_BAND,
    LEE_RATIO,
    LEE_TENSION,
    REST_SLIP,
    REST_TORQUE,
    YOUNG_RAYAN,
    buchner_height,
    dip_on_coupling,
    fitted_postures,
)
from cases.hood_gallery.plots import SAGITTAL_LINES
from cases.hood_gallery.poses import (
    CONVERGED,
    JOINTS,
    REST,
    HoodPoses,
    Posture,
    Pull,
    SolvedPose,
    pull_name,
)
from cosim.analyses.moment_arms import published_arms
from cosim.case.schema import Case
from cosim.errors import Progress, quiet
from cosim.report.figures import Figure, FigurePage, FigureStudy

REST_MCP, REST_PIP = (0.0, 40.0, 80.0), (0.0, 45.0, 90.0)
SLIP_POSTURES: tuple[Posture, ...] = tuple(
    (mcp, pip, dip)
    for mcp in (0.0, 30.0, 60.0)
    for pip, dip in ((0.0, 0.0), (45.0, 15.0), (60.0, 30.0))
)
LEVELS = (1.0, 2.0, 4.0, 8.0, 12.0)
"""N of EDC."""
STRAIGHT: Posture = (0.0, 0.0, 0.0)
SWEEPS = {
    "MCP": (0.0, 20.0, 45.0, 60.0, 80.0),
    "PIP": (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0),
    "DIP": (0.0, 15.0, 30.0, 45.0, 60.0),
}
"""deg of each joint while the others are straight."""
RETURN = (60.0, 30.0, 0.0)
"""deg of the PIP at which it is looked at again on its way back."""
TAUT, SMALL = 3.0, 1.0
"""N of EDC, and of every tendon of the hood."""
AUDIT = (
    "hood_residual",
    "hood_force_balance",
    "hood_moment_balance",
    "max_penetration_mm",
    "layer_used_up",
    "status",
)
WHERE = (*(f"{joint}_deg" for joint in JOINTS), "load")


class HoodStudies:
    """The studies of one case; they share the poses that more than one of them looks at."""

    def __init__(self, case: Case, say: Progress = quiet) -> None:
        self.case, self.say = case, say

    @cached_property
    def poses(self) -> HoodPoses:
        """The hood's poses, built when they are first asked for.  Raises InputError for a case
        without a sheet."""
        return HoodPoses(self.case, self.say)

    def paper(self, command: str) -> FigurePage:
        """The page of all these studies, which `command` draws."""
        studies = (
            FigureStudy(
                "rest", "torques and slips at rest along couplings of PIP and DIP", self.at_rest
            ),
            FigureStudy(
                "slips", "central and terminal slip under EDC, by posture and load", self.slips
            ),
            FigureStudy("arms", "moment arms and excursions of the hood's tendons", self.arms),
            FigureStudy(
                "bands", "height of the lateral bands, glide of the terminal slip", self.bands
            ),
            FigureStudy("sagittal", "angle of the sagittal bands against the MCP", self.sagittal),
        )
        title = f"The hood of {self.case.name} over postures"
        return FigurePage(
            "hood", title, studies, "A hood over postures, beside literature", command
        )

    def unsolved_poses(self) -> list[SolvedPose]:
        """Poses without equilibrium, or whose audit is missed."""
        known = self.poses.known.values() if "poses" in vars(self) else ()
        return [pose for pose in known if pose.status != CONVERGED]

    # --- the studies

    def at_rest(self) -> list[Figure]:
        """Joint torques and slip forces of the hood at resting tension."""
        solved = self.poses.walk("rest", [(p, "flexion") for p in rest_postures()], ())
        table = _table(solved, ("torque", "central", "terminal"), self._fitted_postures("hood."))
        table.insert(0, "DIP_line", [" and ".join(lines_through(p.posture)) for p in solved])
        known = {pose.posture: pose for pose in solved}
        caption = (
            f"Every tendon at the resting tension of {self.poses.models.resting:g} N, the bones "
            "held. A finger at rest is nearly without force: bounds (shaded) of "
            f"{REST_TORQUE:g} N mm, a fifth to a third of what MCP and PIP resist 20 deg off rest, "
            f"and {REST_SLIP:g} N; both are requirements, not measurements. DIP along Buchner's "
            "coupling (1.21 mm/rad)/(3.5 mm) PIP^2, about a quarter of the PIP at 45 deg and half "
            "at 90, along 0.7 PIP as FDP flexes a free finger (Nimbarte et al. 2008), and "
            f"15 deg off either, within 0 to 70 deg. {self._fit_note('hood.', 'rest')}"
            f"{_failure_sentence(solved)}"
        )
        return [
            Figure(
                "rest",
                "At rest: joint torques of the hood and forces of the slips",
                caption,
                pictures.draw_rest(known, REST_MCP, REST_PIP),
                {"rest_summary": rest_summary(solved), "rest": table},
            )
        ]

    def slips(self) -> list[Figure]:
        """Forces in central and terminal slip under EDC."""
        by_posture = self._walk("slips by posture", SLIP_POSTURES, [_edc(LEE_TENSION)])
        flexed = self.case.finger.flexed
        by_load = self._walk("slips by load", (STRAIGHT, flexed), [_edc(n) for n in LEVELS])
        loaded = [pose for pose in by_posture if pose.pull]
        levels = [pose for pose in by_load if pose.pull]
        fitted = self._fitted_postures("slip_ratio")
        one, two = (_slip_table(poses, fitted) for poses in (loaded, levels))
        caption = (
            f"Left: {LEE_TENSION:g} N in EDC at nine postures; the dotted line is a tenth of EDC's "
            "tension, which each slip is to bear at least (a requirement). Right: against EDC's "
            "tension at two postures. Lee et al. 2008 (J Biomech Eng 130:051014, n 5): terminal "
            f"over central slip {LEE_RATIO:g}, nearly independent of posture (dashed); band of the "
            f"target {LEE_BAND[0]:g} to {LEE_BAND[1]:g} (shaded). "
            f"{self._fit_note('slip_ratio', 'the ratio')}"
            f"{_failure_sentence([*by_posture, *by_load])}"
        )
        whole = _table([*by_posture, *by_load], ("central", "terminal", "slip"), fitted)
        return [
            Figure(
                "slips",
                "Central and terminal slip under EDC",
                caption,
                pictures.draw_slips(loaded, levels),
                {"slips_by_posture": one, "slips_by_load": two, "slips": whole},
            )
        ]

    def arms(self) -> list[Figure]:
        """Moment arms and excursions of every tendon of the hood."""
        solved = self._sweeps()
        names = self.poses.tendons
        small = pull_name(self._small)
        table = arm_table(solved, names, self._small)
        known = self._published_arms(names)
        caption = (
            f"Each joint alone, the others straight, {SMALL:g} N in every tendon of the hood. "
            "Tangent arm d torque / d tension at fixed pose, flexion positive; excursion from the "
            "straight finger, positive proximally: its slope against the angle is the arm. "
            + (
                "Diamonds: heights of EDC over the axes, An et al. 1979 (J Biomech 12:775): MCP "
                "9.66, PIP 5.32, DIP 2.0 mm; that at the DIP is the terminal slip's, EDC's arm its "
                "share of it. Crosses: MyoHand at 0/0/0, computed from its MuJoCo model. "
                if len(known)
                else "The published arms at hand are the index finger's. "
            )
            + self._fit_note("moment_arm", "EDC's arms, by difference of torques")
            + _failure_sentence([pose for pose in solved if pull_name(pose.pull) == small])
        )
        return [
            Figure(
                "arms",
                "Moment arms and excursions of the hood's tendons",
                caption,
                pictures.draw_arms(table, known, names),
                {"arms": table, "arms_published": known},
            )
        ]

    def bands(self) -> list[Figure]:
        """Height of the lateral bands over the PIP's axis, and glide of the terminal slip."""
        solved = self._sweeps()
        heights, glides = band_table(solved), glide_table(solved)
        caption = (
            "Left: the lateral bands' middle line over the PIP's axis, in the plane through the "
            "axis that halves the angle between the phalanges; PIP alone, MCP and DIP straight. "
            "Hollow marks: on the way back from 90 deg. Grey: Buchner's parabola 5 - 2.42 PIP "
            "(mm, rad), an assumption with the right ends of the range of motion and no "
            f"measurement; nobody seems to have measured the shift in mm. {_sinking_text(heights)}"
            " Middle: glide of the terminal slip's proximal end along the middle phalanx, right: "
            "that of the lateral bands at the PIP along the proximal phalanx, mean of both sides, "
            "distally, from the straight finger. Schweitzer and Rayan 2004 II (56 digits): the "
            "terminal tendon moves with PIP and DIP, not with the MCP. Here the DIP is held while "
            "the PIP flexes: the slip, which ends on the distal phalanx, then moves along the "
            "middle one by its stretch alone, and the bands show the PIP's part. "
            f"{_glide_sentence(glides)} Nothing here was fitted.{_failure_sentence(solved)}"
        )
        tables = {"lateral_bands": heights, "glide": glides}
        tables["bands"] = _table(solved, ("lateral", "glide"), frozenset(), way=True)
        return [
            Figure(
                "bands",
                "Lateral bands at the PIP, and glide of the terminal slip",
                caption,
                pictures.draw_bands(heights, glides),
                tables,
            )
        ]

    def sagittal(self) -> list[Figure]:
        """Angle of the sagittal bands to the square of the tendon."""
        solved = [pose for pose in self._sweeps() if _is_swept(pose, "MCP")]
        table = sagittal_table(solved)
        caption = (
            "MCP alone. A sagittal band's line runs from its anchor on the palmar plate (on the "
            "base of the proximal phalanx) up to the middle of the tendon as laid over the MCP, or "
            "to the edge of the sheet that the anchor holds; seen along the metacarpal's radial "
            "axis, its angle from the dorsal normal of the metacarpal's long axis, and from that "
            "of the tendon over the joint; positive where it leans distally, mean of both sides. A "
            "line to the edge that is short because its spring is slack has no clear direction. "
            "Young and Rayan 2000 (48 digits): fibres to the square of the tendon 0 deg at MCP 0, "
            "25 at 45, 55 at full flexion (put at 80 deg here); their abstract does not say how "
            f"the square was taken. Nothing here was fitted.{_failure_sentence(solved)}"
        )
        return [
            Figure(
                "sagittal",
                "Sagittal bands against the MCP",
                caption,
                pictures.draw_sagittal(table),
                {"sagittal": table, "sagittal_sides": _table(solved, ("sagittal",), frozenset())},
            )
        ]

    # --- poses and words

    def _walk(
        self, name: str, postures: Sequence[Posture], pulls: Sequence[Pull]
    ) -> list[SolvedPose]:
        return self.poses.walk(name, [(posture, "flexion") for posture in postures], pulls)

    @property
    def _small(self) -> Pull:
        return tuple((tendon, SMALL) for tendon in self.poses.tendons)

    def _sweeps(self) -> list[SolvedPose]:
        return self.poses.walk("each joint alone", sweep_postures(), [_edc(TAUT), self._small])

    def _fitted_postures(self, quantity: str) -> frozenset[Posture]:
        return fitted_postures(quantity) if self.case.finger.has_literature else frozenset()

    def _fit_note(self, quantity: str, what: str) -> str:
        postures = sorted(self._fitted_postures(quantity))
        if not postures:
            return "Nothing of this finger was fitted."
        named = ", ".join("/".join(f"{a:g}" for a in posture) for posture in postures)
        return (
            f"Fitted of the packaged hood: {what}, at {named} (cases/data/hood_fit.toml); all else "
            "here is held out."
        )

    def _published_arms(self, tendons: Sequence[str]) -> pd.DataFrame:
        """Published arms of the hood's tendons in the straight finger; none but the index's."""
        known = published_arms("index")
        known = known[(known.posture_deg == "0/0/0") & known.joint.isin(JOINTS)]
        heights = [
            ("EDC", j, "0/0/0", -h, "An et al. 1979, J Biomech 12:775, height")
            for j, h in AN_HEIGHT.items()
        ]
        every = pd.concat([known, pd.DataFrame(heights, columns=known.columns)])
        known = self.case.finger.has_literature
        return every[every.tendon.isin(tendons) & known].reset_index(drop=True)


def _edc(tension: float) -> Pull:
    return (("EDC", tension),)


def rest_postures() -> list[Posture]:
    """The postures at rest in an order in which each is near the one before, as far as the way is
    easy: with the MCP flexed a straight PIP is reached from a flexed one."""
    out: list[Posture] = []
    forth = True
    for mcp in (*REST_MCP[1:], REST_MCP[0]):
        for pip in REST_PIP if forth else REST_PIP[::-1]:
            dips = sorted({dip_on_coupling(name, pip) for name in COUPLINGS})
            if out and abs(out[-1][2] - dips[-1]) < abs(out[-1][2] - dips[0]):
                dips.reverse()
            out += [(mcp, pip, dip) for dip in dips]
        forth = not forth
    return out


def lines_through(posture: Posture) -> list[str]:
    """The couplings' lines on which a posture lies."""
    return [name for name in COUPLINGS if dip_on_coupling(name, posture[1]) == posture[2]]


def sweep_postures() -> list[tuple[Posture, str]]:
    """Each joint alone, with its way; the PIP there and back."""
    out: list[tuple[Posture, str]] = []
    for joint, angles in SWEEPS.items():
        out += [(_alone(joint, angle), "flexion") for angle in angles if angle or joint == "MCP"]
        if joint == "PIP":
            out += [(_alone(joint, angle), "extension") for angle in RETURN]
    return out


def _alone(joint: str, angle: float) -> Posture:
    mcp, pip, dip = (angle if j == joint else 0.0 for j in JOINTS)
    return mcp, pip, dip


def _is_swept(pose: SolvedPose, joint: str) -> bool:
    """Whether only this joint is flexed, on its way there."""
    rest = [a for j, a in zip(JOINTS, pose.posture, strict=True) if j != joint]
    return not any(rest) and pose.way == "flexion"


def _angle(pose: SolvedPose, joint: str) -> float:
    return pose.posture[JOINTS.index(joint)]


def _table(
    poses: Sequence[SolvedPose],
    begins: tuple[str, ...],
    fitted: frozenset[Posture],
    way: bool = False,
) -> pd.DataFrame:
    """A row for each pose: where, the numbers whose names begin so, and the audit."""
    whole = pd.DataFrame([pose.row() for pose in poses])
    whole["fitted"] = [pose.posture in fitted for pose in poses]
    kept = [name for name in whole if str(name).startswith(begins)]
    where = [*WHERE, "way"] if way else list(WHERE)
    columns = [*where, *kept, *(["fitted"] if fitted else []), *AUDIT]
    return whole.reindex(columns=columns).reset_index(drop=True)


def _number(pose: SolvedPose, name: str) -> float:
    return pose.numbers.get(name, float("nan"))


def rest_summary(poses: Sequence[SolvedPose]) -> pd.DataFrame:
    """A row for each torque and slip: the largest at rest, where, and how many poses keep the
    bound."""
    names = [(f"torque_{joint}_Nmm", REST_TORQUE) for joint in JOINTS]
    names += [(f"{slip}_slip_N", REST_SLIP) for slip in ("central", "terminal")]
    return pd.DataFrame([_extreme(poses, *name) for name in names])


def _extreme(poses: Sequence[SolvedPose], name: str, bound: float) -> dict[str, object]:
    values = np.array([_number(pose, name) for pose in poses])
    finite = np.isfinite(values)
    row: dict[str, object] = {"quantity": name, "largest": float("nan"), "at": "-"}
    if finite.any():
        i = int(np.nanargmax(np.abs(values)))
        row |= {"largest": values[i], "at": "/".join(f"{a:g}" for a in poses[i].posture)}
    within = int((np.abs(values[finite]) <= bound).sum())
    counts = {"within": within, "solved": int(finite.sum()), "poses": len(poses)}
    return {**row, "bound": bound, **counts}


def _slip_table(poses: Sequence[SolvedPose], fitted: frozenset[Posture]) -> pd.DataFrame:
    """What the page shows of the slips."""
    return pd.DataFrame([_slip_row(pose, pose.posture in fitted) for pose in poses])


def _slip_row(pose: SolvedPose, is_fitted: bool) -> dict[str, object]:
    tension = dict(pose.pull)["EDC"]
    slips = [_number(pose, f"{slip}_slip_N") for slip in ("central", "terminal")]
    ratio = _number(pose, "slip_ratio")
    return {
        "posture_deg": "/".join(f"{a:g}" for a in pose.posture),
        "EDC_N": tension,
        "central_N": slips[0],
        "terminal_N": slips[1],
        "ratio": ratio,
        "ratio_in_band": _yes(LEE_BAND[0] <= ratio <= LEE_BAND[1], pose),
        "a_tenth_each": _yes(min(slips) >= LEAST_SHARE * tension, pose),
        "fitted": "yes" if is_fitted and tension == LEE_TENSION else "no",
    }


def _yes(holds: bool, pose: SolvedPose) -> str:
    if not pose.converged:
        return "no equilibrium"
    return "yes" if holds else "no"


def arm_table(poses: Sequence[SolvedPose], tendons: Sequence[str], pull: Pull) -> pd.DataFrame:
    """Arm (mm, tangent) and excursion (mm, from the straight finger) of each tendon about the joint
    that moves, under the same pull."""
    held = [pose for pose in poses if pose.pull == pull]
    start = next((pose for pose in held if pose.posture == STRAIGHT), None)
    rows = []
    for joint in JOINTS:
        for pose in (pose for pose in held if _is_swept(pose, joint)):
            for tendon in tendons:
                key = f"{tendon}_excursion_mm"
                begun = _number(start, key) if start is not None else float("nan")
                rows.append(
                    {
                        "joint": joint,
                        "angle_deg": _angle(pose, joint),
                        "tendon": tendon,
                        "arm_mm": _number(pose, f"{tendon}_{joint}_arm_mm"),
                        "excursion_mm": _number(pose, key) - begun,
                        **{name: pose.row().get(name) for name in AUDIT},
                    }
                )
    return pd.DataFrame(rows)


def band_table(poses: Sequence[SolvedPose]) -> pd.DataFrame:
    """Heights (mm) of both lateral bands against the PIP, there and back, beside Buchner's."""
    rows = []
    for pull in (REST, _edc(TAUT)):
        for pose in poses:
            if pose.pull != pull or pose.posture[0] or pose.posture[2]:
                continue
            sides = [_number(pose, f"lateral_band_height_{s}_mm") for s in ("radial", "ulnar")]
            pip = pose.posture[1]
            rows.append(
                {
                    "PIP_deg": pip,
                    "load": pull_name(pull),
                    "way": pose.way,
                    "radial_mm": sides[0],
                    "ulnar_mm": sides[1],
                    "mean_mm": (sides[0] + sides[1]) / 2,
                    "Buchner_mm": float(buchner_height(np.asarray(pip))),
                    "status": pose.status,
                }
            )
    return pd.DataFrame(rows)


def glide_table(poses: Sequence[SolvedPose]) -> pd.DataFrame:
    """Glide (mm, distally, from straight) of the terminal slip and, mean of both sides, of the
    lateral bands at the PIP, while one joint flexes."""
    rows = []
    for pull in (REST, _edc(TAUT)):
        held = [pose for pose in poses if pose.pull == pull]
        straight = next((p for p in held if p.posture == STRAIGHT and p.way == "flexion"), None)
        slip, bands = _glides(straight) if straight else (float("nan"), float("nan"))
        for joint in JOINTS:
            rows += [
                {
                    "joint": joint,
                    "angle_deg": _angle(pose, joint),
                    "load": pull_name(pull),
                    "terminal_slip_mm": _glides(pose)[0] - slip,
                    "lateral_bands_mm": _glides(pose)[1] - bands,
                    "status": pose.status,
                }
                for pose in held
                if _is_swept(pose, joint)
            ]
    return pd.DataFrame(rows)


def _glides(pose: SolvedPose) -> tuple[float, float]:
    """How far the terminal slip and, in the mean, the lateral bands glide (mm)."""
    bands = [_number(pose, f"glide_lateral_band_{side}_mm") for side in ("radial", "ulnar")]
    return _number(pose, "glide_terminal_slip_mm"), (bands[0] + bands[1]) / 2


def sagittal_table(poses: Sequence[SolvedPose]) -> pd.DataFrame:
    """Angles (deg), mean of both sides, against the MCP."""
    rows = []
    for pull in (REST, _edc(TAUT)):
        for pose in (pose for pose in poses if pose.pull == pull):
            angles = {
                f"{line}_deg": float(
                    np.mean(
                        [_number(pose, f"sagittal_{s}_{line}_deg") for s in ("radial", "ulnar")]
                    )
                )
                for line in SAGITTAL_LINES
            }
            mcp = _angle(pose, "MCP")
            seen = {"Young_Rayan_deg": YOUNG_RAYAN.get(mcp, float("nan"))}
            rows.append({"MCP_deg": mcp, "load": pull_name(pull), **angles, **seen})
    return pd.DataFrame(rows)


def _sinking_text(heights: pd.DataFrame) -> str:
    """How the bands' mean height changes with flexion, and comes back, in words."""
    out = []
    for load, part in heights.groupby("load", sort=False):
        at = {(row.PIP_deg, row.way): row.mean_mm for row in part.itertuples()}
        if (0.0, "flexion") in at and (90.0, "flexion") in at:
            text = (
                f"{load}: {at[0.0, 'flexion']:.1f} mm straight, {at[90.0, 'flexion']:.1f} at 90 deg"
            )
            back = at.get((0.0, "extension"))
            out.append(text if back is None else f"{text}, {back:.1f} straight again")
    return f"Mean of both sides, {'; '.join(out)}."


def _glide_sentence(glides: pd.DataFrame) -> str:
    parts = []
    for joint, part in glides[glides.load != "rest"].groupby("joint", sort=False):
        last = part.loc[part.angle_deg.idxmax()]
        moved = f"{last.terminal_slip_mm:+.2f} and {last.lateral_bands_mm:+.2f} mm"
        parts.append(f"{moved} at {joint} {last.angle_deg:g} deg")
    return f"Under EDC, slip and bands: {', '.join(parts)}."


def _failure_sentence(poses: Sequence[SolvedPose]) -> str:
    """A sentence with the poses without equilibrium and those whose audit is missed."""
    lost = [pose.name for pose in poses if not pose.converged]
    missed = [pose.name for pose in poses if pose.converged and pose.status != CONVERGED]
    kinds = (("No equilibrium (crosses at the bottom)", lost), ("The audit is missed", missed))
    return "".join(f" {what}: {'; '.join(names)}." for what, names in kinds if names)
