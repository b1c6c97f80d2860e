"""The fingertip forces of the seven muscles at the thesis's posture, by fidelity of the hood.

Split, isotropic and fibrous hood, the fibrous one as identified from strains alone, and network are
held as their reference was, `clamped`; the two hoods at a `point` as well, as in the thesis.  The
thesis's one-way pass stands beside the two-way equilibrium of the same hood."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from cosim import units
from cosim.case import load_case
from cosim.case_schema import FibreMooneyRivlin, ShellHood
from cosim.compare import Comparison, Target
from cosim.port import Array
from cosim.validation_trial import Summaries, Trial, at_most
from cosim.variations import toe_settings, written

NEAR, ANGLE = 0.60, 30.0
"""N and deg: how near to experiment the thesis's successor comes (Jadelis et al. 2023, J Biomech
157:111725)."""
BAND = "Jadelis et al. 2023, abstract"
MUSCLES = ("EDC", "EI", "LUM", "FPI", "FDP", "FDS", "FDI")
FORCE_CASES = {"split": "split", "iso": "fingertip_isotropic", "ti": "fingertip_fibres"}
IDENTIFIED = "strain_lee2008_identified"
THROUGH_THE_HOOD = ("EDC", "EI", "LUM", "FPI")
THROUGH_THE_NETWORK = ("EDC", "LUM", "FPI")
"""The paper of the network has no EI."""
EXCESS = {"EDC": 4.69, "EI": 4.66, "LUM": 1.76, "FPI": 0.19}
"""N over the experiment's mean, of the one-way pass (thesis, section 3.4)."""
THESIS = "Jadelis, thesis, section 3.4: excess over Qiu's experiment, whose spread was not seen"
ONE_WAY, TWO_WAY = "force one-way", "force two-way"


def force_trials() -> Iterator[Trial]:
    """Those compared with the two models, by the last word of their names."""
    clamped, point = (f'finger.tip.kind="{kind}"' for kind in ("clamped", "point"))
    for (law, case), muscle in itertools.product(FORCE_CASES.items(), MUSCLES):
        yield Trial(f"force {law} {muscle}", f"{case}_{muscle.lower()}", (clamped,))
    identified = identified_material()
    for muscle in THROUGH_THE_HOOD:
        case = f"{FORCE_CASES['ti']}_{muscle.lower()}"
        yield Trial(f"force identified {muscle}", case, (clamped, *identified))
    for muscle in THROUGH_THE_NETWORK:
        yield Trial(f"force network {muscle}", f"network_{muscle.lower()}", (clamped,))
    for law, muscle in itertools.product(("iso", "ti"), MUSCLES):
        case = f"{FORCE_CASES[law]}_{muscle.lower()}"
        yield Trial(f"force {law}, point {muscle}", case, (point,))


@cache
def identified_material() -> tuple[str, ...]:
    """Settings of the fibrous hood's materials, as they were identified."""
    hood = load_case(IDENTIFIED).hood
    assert isinstance(hood, ShellHood)
    return tuple(
        setting
        for name, region in hood.regions.items()
        if isinstance(region, FibreMooneyRivlin)
        for setting in (
            f"hood.regions.{name}.c1={written(region.c1, units.PRESSURE)}",
            *toe_settings(name, region.c5, region.c4, region.lam_max - 1),
        )
    )


def thesis_trials() -> Iterator[Trial]:
    """The one-way pass and, on the same hood, the two-way equilibrium; both held at a point."""
    laid = ('hood.mesh.elements="quadratic"',)  # of which its forces change less with the mesh
    for muscle in EXCESS:
        yield Trial(f"{ONE_WAY} {muscle}", f"thesis_one_way_{muscle.lower()}", laid)
        yield Trial(f"{TWO_WAY} {muscle}", f"isometric_{muscle.lower()}", laid)


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


def force_rows(trials: Sequence[Trial], summaries: Summaries) -> Iterator[Comparison]:
    """What is not a number of one trial's summary."""
    names = {t.name for t in trials}
    yield from near_models([t for t in force_trials() if t.name in names], summaries)
    for muscle, excess in EXCESS.items():
        pair = f"{ONE_WAY} {muscle}", f"{TWO_WAY} {muscle}"
        if names.issuperset(pair):
            yield from over_the_coupled(pair, excess, summaries)


def over_the_coupled(
    pair: tuple[str, str], excess: float, summaries: Summaries
) -> Iterator[Comparison]:
    """What the thesis's pass has beyond the two-way equilibrium, beside its own `excess` (N), and
    each tip force beside the most that its tendon can do."""
    said = [summaries.get(name) for name in pair]
    forces = [s["fingertip_magnitude_N"] for s in said if s is not None]
    over = forces[0] - forces[1] if len(forces) == 2 else None
    target = Target(
        f"{pair[0]}: tip force beyond the two-way one",
        "fingertip_magnitude_N",
        "N",
        excess,
        None,
        None,
        None,
        THESIS,
        "published model",
        pair[0],
        note="held at a point; the thesis's own excess is over an experiment",
    )
    yield Comparison(target, over)
    for name, own in zip(pair, said, strict=True):
        if own is not None:
            yield within_bound(name, own)


def within_bound(name: str, said: Mapping[str, Any]) -> Comparison:
    """The tip force of a pass, or of the equilibrium beside it, and the most that its tendon can
    do."""
    what, key = f"{name}: no more than the tendon can do", "fingertip_magnitude_N"
    target = at_most(what, key, "N", said["bound_N"], "statics", "inferred")
    return Comparison(replace(target, case=name), said[key])


def share_of_bound(name: str, said: Mapping[str, Any]) -> Comparison:
    """The tip force of an equilibrium over the most that its tendon can do, which changes with the
    model as the force does."""
    what, force = f"{name}: no more than the tendon can do", said["fingertip_magnitude_N"]
    target = at_most(what, "share_of_bound", "1", 1.0, "statics", "inferred")
    note = f"{force:.3g} N of {said['bound_N']:.3g} N"
    return Comparison(replace(target, case=name, note=note), force / said["bound_N"])


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
        yield Comparison(at_most(name, "angle_deg", "deg", ANGLE, BAND, "published model"), nearest)
        if said is not None and "bound_N" in said:
            yield share_of_bound(trial.name, said)


def angle_between(a: Array, b: Array) -> float:
    """deg."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
