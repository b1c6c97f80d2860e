"""What `cosim validate` runs, and what it compares with: trials and targets by group."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np

from cosim.compare import Comparison, Target, compared, value_of
from cosim.compare_files import read_targets
from cosim.port import Array

NEAR, ANGLE = 0.60, 30.0
"""N and deg: how near to experiment the thesis's successor comes (Jadelis et al. 2023, J Biomech
157:111725)."""
BAND = "Jadelis et al. 2023, abstract"
LEE = "Lee et al. 2008, abstract"
MCP, IP = (0, 30, 60), ((0, 0), (45, 15), (60, 30))
"""deg, the nine postures."""
LOST = 0.7
"""More than 30 % of the slips' force is lost in MCP flexion with straight IP joints [LEE]."""
MODULI = {"soft": -1.0, "average": 0.0, "stiff": 1.0}
"""SD from the means of the thesis's table 4."""
MUSCLES = ("EDC", "EI", "LUM", "FPI", "FDP", "FDS", "FDI")
FORCE_CASES = {"split": "split", "iso": "fingertip_isotropic", "ti": "fingertip_fibres"}
CADAVER, POSTURES = ("middle", "hood"), ("minorflex", "majorflex")
"""Cases with the fixed split and with the coupled hood."""
THROUGH = ("edc", "lum", "ri", "ui")
LOADED = (*THROUGH, "fdp", "fds")
HANDS = ("H01", "H02", "H03")
SYNEK = "Synek et al. 2019, PeerJ 7:e7470, raw data"
Summaries = Mapping[str, Mapping[str, Any]]
"""Of the trials that converged, by name."""


@dataclass(frozen=True)
class Trial:
    """A case with settings of its own."""

    name: str
    case: str
    settings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Group:
    """Trials, and the rows that compare what they said."""

    name: str
    trials: tuple[Trial, ...]
    targets: tuple[Target, ...]
    """By trial, as their `case`."""


def groups(published: Path | None = None) -> tuple[Group, ...]:
    """All validations, in the order of the scoreboard; those of the published hood where its file
    is given.  Raises InputError for faulty data."""
    strains = data("validation_strain.csv")
    other = tuple(published_trials(published)) if published is not None else ()
    return (
        Group("strain", tuple(strain_trials()), strains),
        *([Group("published hood", other, strains)] if other else []),
        Group("force", tuple(force_trials()), tuple(force_targets())),
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
        yield from near_models(group.trials, summaries)
    if group.name == "cadaver":
        yield from near_hands(group, summaries)


# Strain -------------------------------------------------------------------------------------------


def strain_trials() -> Iterator[Trial]:
    for modulus, law in itertools.product(MODULI, ("ti", "iso")):
        yield Trial(f"strain {modulus} {law}", f"strain_lee2008_{modulus}_{law}")
    for law, mcp, (pip, dip) in itertools.product(("ti", "iso"), MCP, IP):
        if (mcp, pip) != (0, 0):
            angles = {"MCP": mcp, "PIP": pip, "DIP": dip}
            settings = tuple(f'finger.posture.{j}="{a} deg"' for j, a in angles.items())
            yield Trial(posed(law, mcp, pip, dip), f"strain_lee2008_average_{law}", settings)


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
    joints straight; of the pairs whose trials are asked for."""
    bent = [((mcp, *ip), (mcp, 0, 0), 1.0) for mcp, ip in itertools.product(MCP, IP[1:])]
    pairs = [*bent, ((MCP[-1], 0, 0), (0, 0, 0), LOST)]
    for law, slip, (now, then, most) in itertools.product(
        ("ti", "iso"), ("central", "terminal"), pairs
    ):
        names = posed(law, *now), posed(law, *then)
        if not trials.issuperset(names):
            continue
        over, under = (
            value_of(summaries.get(name, {}), f"difference.slip_force_N.{slip}") for name in names
        )
        value = None if over is None or not under else over / under
        words = ["/".join(map(str, posture)) for posture in (now, then)]
        name = f"average {law}: {slip} slip at {words[0]} over {words[1]}"
        yield Comparison(_bound(name, "slip force ratio", "1", most, LEE, "experiment"), value)


def _bound(name: str, quantity: str, unit: str, high: float, source: str, kind: Any) -> Target:
    return Target(name, quantity, unit, None, None, None, high, source, kind)


# Force at the thesis's posture --------------------------------------------------------------------


def force_trials() -> Iterator[Trial]:
    for (law, case), muscle in itertools.product(FORCE_CASES.items(), MUSCLES):
        clamped = ('finger.tip.kind="clamped"',)
        yield Trial(f"force {law} {muscle}", f"{case}_{muscle.lower()}", clamped)
    for law, muscle in itertools.product(("iso", "ti"), MUSCLES):
        case = f"{FORCE_CASES[law]}_{muscle.lower()}"
        yield Trial(f"force {law}, point {muscle}", case, ('finger.tip.kind="point"',))


def two_models() -> dict[str, dict[str, Array]]:
    """(3,) N, distal, palmar, radial, by muscle and source."""
    text = (files("cases") / "data" / "fingertip_two_models.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    out: dict[str, dict[str, Array]] = {}
    for row in csv.DictReader(lines):
        vector = np.array([float(row[c]) for c in ("distal", "palmar", "radial")])
        out.setdefault(row["muscle"], {})[row["source"]] = vector
    return out


def force_targets() -> Iterator[Target]:
    for trial in force_trials():
        muscle = trial.name.split()[-1]
        note = "held at a point; the reference is clamped" if "point" in trial.name else "clamped"
        for source, vector in two_models()[muscle].items():
            for component, value in zip(("distal", "palmar", "radial"), vector, strict=True):
                v = float(value)
                yield Target(
                    f"{trial.name}: {component}, {source}",
                    f"difference.fingertip_force_N.{component}",
                    "N",
                    v,
                    None,
                    round(v - NEAR, 4),
                    round(v + NEAR, 4),
                    f"{source}, band {BAND}",
                    "published model",
                    trial.name,
                    note=note,
                )


def near_models(trials: Sequence[Trial], summaries: Summaries) -> Iterator[Comparison]:
    """Magnitude and direction against the two models' band, and the physical bound."""
    for trial in trials:
        muscle, said = trial.name.split()[-1], summaries.get(trial.name)
        models = list(two_models()[muscle].values())
        force = None if said is None else np.array(said["difference"]["fingertip_force_N"])
        size = sorted(float(np.linalg.norm(m)) for m in models)
        yield Comparison(
            Target(
                f"{trial.name}: magnitude",
                "difference.fingertip_magnitude_N",
                "N",
                None,
                None,
                round(size[0] - NEAR, 4),
                round(size[-1] + NEAR, 4),
                f"An 1979 and MyoHand, band {BAND}",
                "published model",
                trial.name,
            ),
            None if force is None else float(np.linalg.norm(force)),
        )
        nearest = None if force is None else min(angle_between(force, m) for m in models)
        name = f"{trial.name}: angle to the nearer model"
        yield Comparison(_bound(name, "angle_deg", "deg", ANGLE, BAND, "published model"), nearest)
        if said is not None and "bound_N" in said:
            name = f"{trial.name}: no more than the tendon can do"
            target = _bound(
                name, "fingertip_magnitude_N", "N", said["bound_N"], "statics", "inferred"
            )
            yield Comparison(target, said["fingertip_magnitude_N"])


def angle_between(a: Array, b: Array) -> float:
    """deg."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


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
            target = _bound(name, "rmse_N", "N", most, SYNEK, "experiment")
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
            target = _bound(name, quantity, unit, high, SYNEK, "experiment")
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
