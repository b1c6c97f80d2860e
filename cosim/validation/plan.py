"""What `cosim validate` runs, and what it compares with: trials and targets by group.

Groups are of one kind of reference, experiments first; the shipped hood's stand before variants of
it, whose rows are beside the same numbers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib.resources import as_file, files
from pathlib import Path

from cosim.measured import SECOND_HAND, measured_at
from cosim.results.compare import (
    Comparison,
    Target,
    compare_with_targets,
    read_targets,
    verdict,
)
from cosim.results.conventions import is_slack
from cosim.validation.clamped import cadaver_arm_group, metacarpal_group, qiu_groups
from cosim.validation.force import attachment_group, force_groups
from cosim.validation.free_finger import held_trial, needed_stiffness
from cosim.validation.lengths import OWN_ZERO, length_groups
from cosim.validation.ratios import cohn_groups, share_group
from cosim.validation.trial import Summaries, Trial, TrialGroup, posture_settings

MCP, IP = (0, 30, 60), ((0, 0), (45, 15), (60, 30))
"""deg, the nine postures of Lee's fingers."""
ANY_LOSS = 1e-3
"""Share of a force whose loss counts as one, where a source prints that it falls, not how far."""
FALLS = {"IP joints flex": "IP", "MCP flexes": "MCP"}
"""Losses of the collection: with the IP joints, and with the MCP as the IP joints are straight."""
MODULI = {"soft": -1.0, "average": 0.0, "stiff": 1.0}
"""SD from the means of the thesis's table 4."""
LEE_LOAD = 11.8
"""N in EDC."""
MARKERS = "difference.grid_strain_percent.markers"
"""Strains between Lee's markers, whose layout is an assumption of `cases/strain`."""
POSTURES = {"minorflex": "40/55/35", "majorflex": "55/57/25"}
"""deg, MCP/PIP/DIP of the middle finger's cases."""
THROUGH, PAST = ("edc", "lum", "ri", "ui"), ("fdp", "fds")
"""Muscles of the middle finger that act through its hood, and that no hood touches."""
HANDS = ("H01", "H02", "H03")
EXTRINSIC = ("edc", "ei", "fdp", "fds")
STRAIGHT = "strain average ti"


def groups(published: Path | None = None) -> tuple[TrialGroup, ...]:
    """All validations, in the order of the scoreboard; those of the published hood where its file
    is given.  Raises InputError for faulty data."""
    two_models, past, *other_models = force_groups()
    lengths, other_lengths = length_groups()
    cadaver, flexors, split = cadaver_groups()
    qiu, qiu_flexor, *qiu_variants = qiu_groups()
    cohn, cohn_past, *cohn_variants = cohn_groups()
    free, free_split = free_groups()
    strains, slips, slip_strain, laws = lee_groups()
    published_groups = (published_group(published),) if published is not None else ()
    experiments = (cadaver, flexors, qiu, qiu_flexor, cohn, cohn_past)
    second_hand = (strains, slips, free, lengths, share_group())
    arms = (cadaver_arm_group(g) for g in (cadaver, flexors, split))
    clamped = (*arms, *qiu_variants, *cohn_variants, metacarpal_group())
    variants = (split, *clamped, free_split, laws, other_lengths, *other_models, *published_groups)
    models = (two_models, past, attachment_group())
    inferred = (slip_strain, strip_arm_group([*slips.trials, *cadaver.trials]))
    return (*experiments, *second_hand, *models, *inferred, fitted_group(), *variants)


@cache
def data(name: str) -> tuple[Target, ...]:
    """The targets of a packaged file."""
    with as_file(files("cases") / "data" / name) as path:
        return read_targets(path)


def rows_of(group: TrialGroup, summaries: Summaries) -> Iterator[Comparison]:
    """Every comparison of a group; a trial that did not converge has no value."""
    for trial in group.trials:
        mine = [t for t in group.targets if t.case == trial.name]
        yield from compare_with_targets(mine, summaries.get(trial.name, {}), trial.name)
    if group.derived is not None:
        names = {t.name for t in group.trials}
        yield from (row for row in group.derived(summaries) if row.target.case in names)


def split_answers(
    group: TrialGroup, rows: Sequence[Comparison], summaries: Summaries
) -> dict[Target, float | None]:
    """What the fixed split says of the rows whose trial has a partner that gave an answer."""
    partners = {t: summaries[p] for t, p in group.partners.items() if p in summaries}
    answers = {(r.target.case, r.target.name): r.model for r in rows_of(group, partners)}
    mine = (r.target for r in rows if r.target.case in partners)
    return {t: answers[t.case, t.name] for t in mine}


def targets_of(trial: str, targets: Sequence[Target], geometry: str = "") -> tuple[Target, ...]:
    """The targets as those of a trial."""
    return tuple(
        replace(t, name=f"{trial}: {t.name}", case=trial, geometry=geometry) for t in targets
    )


# Lee et al. 2008 ----------------------------------------------------------------------------------


def lee_groups() -> tuple[TrialGroup, TrialGroup, TrialGroup, TrialGroup]:
    """Strains, slips' forces and the inferred strain of the central slip with the shipped hood; and
    all of them, at 0/0/0 deg, with other moduli and the isotropic law."""
    straight = (lee_trial(0, 0, 0),)
    printed, inferred = lee_strains()
    (ratio,) = data("lee2008_slips.csv")
    postures = tuple(lee_trial(mcp, *ip) for mcp, ip in itertools.product(MCP, IP))
    bent = [targets_of(t.name, [ratio]) for t in postures if t.name != STRAIGHT]
    slips = tuple(itertools.chain.from_iterable(bent))
    others = tuple(
        Trial(f"strain {modulus} {law}", f"strain_lee2008_{modulus}_{law}", muscle="EDC")
        for modulus, law in itertools.product(MODULI, ("ti", "iso"))
        if (modulus, law) != ("average", "ti")
    )
    every = [targets_of(t.name, [*printed, ratio]) for t in others]
    derived = partial(losses, {t.name for t in postures})
    return (
        TrialGroup("Lee 2008: strains", SECOND_HAND, straight, targets_of(STRAIGHT, printed)),
        TrialGroup("Lee 2008: slip forces", SECOND_HAND, postures, slips, derived=derived),
        TrialGroup("inferred: central slip", "inferred", straight, targets_of(STRAIGHT, inferred)),
        TrialGroup(
            "Lee 2008: other moduli and law",
            SECOND_HAND,
            others,
            tuple(itertools.chain.from_iterable(every)),
            variant=True,
        ),
    )


def lee_strains() -> tuple[list[Target], list[Target]]:
    """Those printed, and those inferred."""
    every = data("lee2008_strain.csv")
    return [t for t in every if t.kind == SECOND_HAND], [t for t in every if t.kind == "inferred"]


def lee_trial(mcp: int, pip: int, dip: int) -> Trial:
    """The shipped hood in a posture."""
    settings = posture_settings(mcp, pip, dip)
    title = f'title="Lee 2008: 11.8 N in EDC at {mcp}/{pip}/{dip} deg, fibres in a matrix"'
    return Trial(
        trial_name(mcp, pip, dip),
        "strain_lee2008_average_ti",
        (*settings, title) if mcp or pip or dip else (),
        muscle="EDC",
        posture=f"{mcp}/{pip}/{dip}",
    )


def trial_name(mcp: int, pip: int, dip: int) -> str:
    """The name of a trial of the shipped hood."""
    return STRAIGHT if (mcp, pip, dip) == (0, 0, 0) else f"{STRAIGHT} {mcp}/{pip}/{dip}"


def losses(trials: set[str], summaries: Summaries) -> Iterator[Comparison]:
    """Which share of its force each slip loses as IP joints or MCP flex, where it is not slack
    before; of the pairs whose trials are asked for."""
    with_ip, with_mcp = FALLS
    least = {words: least_loss(joints) for words, joints in FALLS.items()}
    bent = [((mcp, *ip), (mcp, 0, 0), with_ip) for mcp, ip in itertools.product(MCP, IP[1:])]
    pairs = [*bent, ((MCP[-1], 0, 0), (0, 0, 0), with_mcp)]
    for slip, (flexed, start, joints) in itertools.product(("central", "terminal"), pairs):
        names = trial_name(*flexed), trial_name(*start)
        if not trials.issuperset(names):
            continue
        forces = [
            summaries.get(name, {}).get("difference", {}).get("slip_force_N") for name in names
        ]
        value = None
        if all(forces) and not is_slack(forces[1], slip):
            value = 1 - forces[0][slip] / forces[1][slip]
        words = ["/".join(map(str, posture)) for posture in (start, flexed)]
        yield Comparison(
            Target(
                f"{slip} slip: force lost as the {joints}, {words[0]} to {words[1]}",
                "lost_share",
                "1",
                None,
                None,
                least[joints],
                None,
                "Lee et al. 2008, abstract",
                SECOND_HAND,
                names[0],
            ),
            value,
        )


def least_loss(joints: str) -> float:
    """The least share of its force that each slip loses as joints flex."""
    return max(measured_at(f"lee2008:slip_force_loss.both.{joints}").low or 0.0, ANY_LOSS)


def fitted_group() -> TrialGroup:
    """What the hood was fitted to under Lee's load at 0/0/0 deg, which judges nothing."""
    chosen = [t for t in data("hood_fit_rows.csv") if t.fitted and t.case == "rest_0_0_0"]
    targets = targets_of(STRAIGHT, chosen)
    return TrialGroup("fitted numbers", SECOND_HAND, (lee_trial(0, 0, 0),), targets)


def strip_arm_group(trials: Sequence[Trial]) -> TrialGroup:
    """Arms of strips that no fit chose, in those of the trials that have a row."""
    targets = data("strip_arms.csv")
    cases = {target.case for target in targets}
    mine = tuple(trial for trial in trials if trial.name in cases)
    return TrialGroup("inferred: arm of the terminal slip", "inferred", mine, targets)


def published_group(path: Path) -> TrialGroup:
    """The published hood, whose case is its own file; it has no markers, so that strains are the
    sheet's."""
    trials = tuple(Trial(f"published hood {m}", str(path), published=m) for m in MODULI)
    printed, _ = lee_strains()
    of_sheet = [replace(t, quantity=t.quantity.replace(MARKERS, "strain_percent")) for t in printed]
    rows = [*of_sheet, *data("lee2008_slips.csv")]
    every = [targets_of(t.name, rows, geometry="published hood") for t in trials]
    targets = tuple(itertools.chain.from_iterable(every))
    return TrialGroup("published hood", SECOND_HAND, trials, targets, variant=True)


# The free finger of Nimbarte et al. 2008 ----------------------------------------------------------


def free_groups() -> tuple[TrialGroup, TrialGroup]:
    """The trials with the shipped hood, with the stiffness that the angles ask for, and with the
    fixed split."""
    hood, split = (
        tuple(Trial(f"{words}_{m}", f"{words}_{m}", muscle=m.upper()) for m in EXTRINSIC)
        for words in ("free", "free_split")
    )
    partners = dict(zip((t.name for t in hood), (t.name for t in split), strict=True))
    targets = data("nimbarte2008_motion.csv")
    others = tuple(replace(t, case=partners[t.case]) for t in targets)
    by_case = {trial.case: trial for trial in hood}
    held = [held_trial(by_case[c], targets) for c in dict.fromkeys(t.case for t in targets)]
    trials, needed = (*hood, *held), partial(needed_stiffness, held, targets)
    return (
        TrialGroup(
            "free finger: hood", SECOND_HAND, trials, targets, partners=partners, derived=needed
        ),
        TrialGroup("free finger: fixed split", SECOND_HAND, split, others, variant=True),
    )


# The middle fingers of Synek et al. 2019 ----------------------------------------------------------


def cadaver_groups() -> tuple[TrialGroup, TrialGroup, TrialGroup]:
    """The hood, the flexors, which no hood touches, and the fixed split."""
    hood, past, split = (
        tuple(
            Trial(name, name, muscle=muscle.upper(), posture=angles)
            for (posture, angles), muscle in itertools.product(POSTURES.items(), muscles)
            for name in [f"{model}_{posture}_{muscle}"]
        )
        for model, muscles in (("hood", THROUGH), ("middle", PAST), ("middle", THROUGH))
    )
    partners = dict(zip((t.name for t in hood), (t.name for t in split), strict=True))
    return (
        _cadaver("cadaver forces: hood", hood, partners=partners),
        _cadaver("cadaver forces: flexors", past),
        _cadaver("cadaver forces: fixed split", split, variant=True),
    )


def _cadaver(
    name: str,
    trials: tuple[Trial, ...],
    *,
    variant: bool = False,
    partners: Mapping[str, str] | None = None,
) -> TrialGroup:
    """The components' means with the hands' SD; the magnitude follows from them."""
    names = {t.name for t in trials}

    def forces(file: str) -> list[Target]:
        mine = (t for t in data(file) if t.case in names)
        return [t for t in mine if "force_in_phalanx" in t.quantity]

    means = tuple(_mark_zero(t) for t in forces("synek2019_fingertip.csv"))
    each = forces("synek2019_specimens.csv")
    hands = {hand: tuple(t for t in each if f", {hand}, " in t.name) for hand in HANDS}
    return TrialGroup(name, "experiment", trials, means, variant, partners or {}, hands)


def _mark_zero(target: Target) -> Target:
    """Says where zero lies within the spread of the hands themselves."""
    if verdict(target, 0.0) != "inside 1 SD":
        return target
    return replace(target, note=f"{target.note}; {OWN_ZERO}")
