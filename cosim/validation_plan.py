"""What `cosim validate` runs, and what it compares with: trials and targets by group."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from cosim.compare import Comparison, Target, compared
from cosim.compare_files import read_targets
from cosim.port import Array
from cosim.strains import is_slack
from cosim.validation_force import (
    angle_between,
    force_rows,
    force_targets,
    force_trials,
    thesis_trials,
)
from cosim.validation_trial import Group, Summaries, Trial, at_most

LEE = "Lee et al. 2008, abstract"
MCP, IP = (0, 30, 60), ((0, 0), (45, 15), (60, 30))
"""deg, the nine postures."""
LOST = 0.7
"""More than 30 % of the slips' force is lost in MCP flexion with straight IP joints [LEE]."""
MODULI = {"soft": -1.0, "average": 0.0, "stiff": 1.0}
"""SD from the means of the thesis's table 4."""
LAWS = {"ti": "fibres in a matrix", "iso": "isotropic"}
CADAVER, POSTURES = ("middle", "hood"), ("minorflex", "majorflex")
"""Cases with the fixed split and with the coupled hood."""
THROUGH = ("edc", "lum", "ri", "ui")
LOADED = (*THROUGH, "fdp", "fds")
HANDS = ("H01", "H02", "H03")
SYNEK = "Synek et al. 2019, PeerJ 7:e7470, raw data"


def groups(published: Path | None = None) -> tuple[Group, ...]:
    """All validations, in the order of the scoreboard; those of the published hood where its file
    is given.  Raises InputError for faulty data."""
    strains = data("validation_strain.csv")
    other = tuple(published_trials(published)) if published is not None else ()
    return (
        Group("strain", tuple(strain_trials()), strains),
        *([Group("published hood", other, strains)] if other else []),
        Group("force", (*force_trials(), *thesis_trials()), tuple(force_targets())),
        Group("cadaver", tuple(cadaver_trials()), data("synek2019_fingertip.csv")),
    )


def data(name: str) -> tuple[Target, ...]:
    """The targets of a packaged file."""
    with as_file(files("cases") / "data" / name) as path:
        return read_targets(path)


def rows_of(group: Group, summaries: Summaries) -> Iterator[Comparison]:
    """Every comparison of a group; a trial that did not converge has no value."""
    for trial in group.trials:
        mine = [t for t in group.targets if t.case == trial.name]
        yield from compared(mine, summaries.get(trial.name, {}), trial.name)
    if group.name == "strain":
        yield from trends({t.name for t in group.trials}, summaries)
    if group.name == "force":
        yield from force_rows(group.trials, summaries)
    if group.name == "cadaver":
        yield from near_hands(group, summaries)


# Strain -------------------------------------------------------------------------------------------


def strain_trials() -> Iterator[Trial]:
    for modulus, law in itertools.product(MODULI, LAWS):
        yield Trial(f"strain {modulus} {law}", f"strain_lee2008_{modulus}_{law}")
    yield Trial("strain identified", "strain_lee2008_identified")
    for law, mcp, (pip, dip) in itertools.product(LAWS, MCP, IP):
        if (mcp, pip) != (0, 0):
            angles = {"MCP": mcp, "PIP": pip, "DIP": dip}
            settings = tuple(f'finger.posture.{j}="{a} deg"' for j, a in angles.items())
            title = f'title="Lee 2008: 11.8 N in EDC at {mcp}/{pip}/{dip} deg, {LAWS[law]}"'
            case = f"strain_lee2008_average_{law}"
            yield Trial(posed(law, mcp, pip, dip), case, (*settings, title))


def published_trials(path: Path) -> Iterator[Trial]:
    """A trial whose case is the hood's own file."""
    for modulus in MODULI:
        yield Trial(f"published hood {modulus}", str(path))


def posed(law: str, mcp: int, pip: int, dip: int) -> str:
    """The name of a trial at mean moduli."""
    straight = (mcp, pip, dip) == (0, 0, 0)
    return f"strain average {law}" + ("" if straight else f" {mcp}/{pip}/{dip}")


def trends(trials: set[str], summaries: Summaries) -> Iterator[Comparison]:
    """How the slips' forces change with posture: over those with straight IP joints, and with all
    joints straight, where the slip is not slack; of the pairs whose trials are asked for."""
    bent = [((mcp, *ip), (mcp, 0, 0), 1.0) for mcp, ip in itertools.product(MCP, IP[1:])]
    pairs = [*bent, ((MCP[-1], 0, 0), (0, 0, 0), LOST)]
    for law, slip, (now, then, most) in itertools.product(LAWS, ("central", "terminal"), pairs):
        names = posed(law, *now), posed(law, *then)
        if not trials.issuperset(names):
            continue
        found = [
            summaries.get(name, {}).get("difference", {}).get("slip_force_N") for name in names
        ]
        value = None
        if all(found) and not is_slack(found[1], slip):
            value = found[0][slip] / found[1][slip]
        words = ["/".join(map(str, posture)) for posture in (now, then)]
        name = f"average {law}: {slip} slip at {words[0]} over {words[1]}"
        yield Comparison(at_most(name, "slip force ratio", "1", most, LEE, "experiment"), value)


# Cadaver ------------------------------------------------------------------------------------------


def cadaver_trials() -> Iterator[Trial]:
    for model, posture, muscle in itertools.product(CADAVER, POSTURES, LOADED):
        name = f"{model}_{posture}_{muscle}"
        yield Trial(name, name)


def near_hands(group: Group, summaries: Summaries) -> Iterator[Comparison]:
    """Coupled hood and fixed split over all trials that converged with both: RMSE of the components
    of the tendons that act through the hood, for the hands' mean and hand by hand; magnitudes and
    directions."""
    if {t.name for t in group.trials} != {t.name for t in cadaver_trials()}:
        return
    by_hand = {"mean": group.targets}
    for hand in HANDS:
        specimens = data("synek2019_specimens.csv")
        by_hand[hand] = tuple(t for t in specimens if f", {hand}, " in t.name)
    for hand, targets in by_hand.items():
        split, hood = (_vectors(m, THROUGH, targets, summaries) for m in CADAVER)
        both = sorted(set(split) & set(hood))
        if both:
            name = f"{', '.join(m.upper() for m in THROUGH)}, {hand}: RMSE, coupled hood"
            note = f"bound: that of the fixed split; {len(both)} of {2 * len(THROUGH)} trials"
            most, found = (_rms([v[k] for k in both]) for v in (split, hood))
            target = at_most(name, "rmse_N", "N", most, SYNEK, "experiment")
            yield Comparison(replace(target, note=note), found)
    for model, word in zip(CADAVER, ("fixed split", "coupled hood"), strict=True):
        found_pairs = list(_vectors(model, LOADED, group.targets, summaries).values())
        sizes = [abs(float(np.linalg.norm(a) - np.linalg.norm(b))) for a, b in found_pairs]
        angles = [angle_between(a, b) for a, b in found_pairs]
        note = f"{len(found_pairs)} of {2 * len(LOADED)} trials"
        for quantity, unit, high, value in (
            ("mean magnitude error", "N", 0.30, float(np.mean(sizes)) if sizes else None),
            ("median angle", "deg", 20.0, float(np.median(angles)) if angles else None),
        ):
            name = f"all tendons: {quantity}, {word}"
            target = at_most(name, quantity, unit, high, SYNEK, "experiment")
            yield Comparison(replace(target, note=note), value)


def _vectors(
    model: str, muscles: Sequence[str], targets: Sequence[Target], summaries: Summaries
) -> dict[str, tuple[Array, Array]]:
    """Force of the model and measured force, (3,) N in the distal phalanx's frame, by posture and
    muscle, of the trials that have a value."""
    out = {}
    for posture, muscle in itertools.product(POSTURES, muscles):
        name = f"{model}_{posture}_{muscle}"
        mine = [t for t in targets if t.case == name and "force_in_phalanx" in t.quantity]
        rows = compared(mine, summaries.get(name, {}), name)
        if rows and all(c.model is not None for c in rows):
            measured = np.array([c.target.reference for c in rows])
            out[f"{posture} {muscle}"] = np.array([c.model for c in rows]), measured
    return out


def _rms(pairs: Sequence[tuple[Array, Array]]) -> float:
    """N, over the components."""
    return float(np.sqrt(np.mean([(a - b) ** 2 for a, b in pairs])))
