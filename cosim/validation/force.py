"""Forces beside those of published models: of the fingertip by seven muscles at 30/45/15 deg, and
of the slips of a middle finger.

No experiment: the fingertip's forces are statics of An's normative paths and of MyoHand's moment
arms.  Neither prints a spread, so that no row has a band.  The tendons of our split, and of the
flexors, run along An's own paths: these are compared with MyoHand alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from cosim.measured import read_measured
from cosim.results.compare import Target
from cosim.text_tables import packaged_rows
from cosim.validation.trial import Trial, TrialGroup, angles_of, posture_settings

CLAMPED = 'finger.tip.kind="clamped"'
THROUGH_THE_HOOD = ("EDC", "EI", "LUM", "FPI")
THROUGH_THE_NETWORK = ("EDC", "LUM", "FPI")
"""The paper of the network has no EI."""
PAST_THE_HOOD = ("FDP", "FDS", "FDI")
"""Muscles that no hood touches: they are judged once."""
AN, MYOHAND = "An 1979", "MyoHand"
PRINTED = ("distal", "palmar", "radial")
"""The axes that the two models print."""
CASES = {"ti": "fingertip_fibres", "iso": "fingertip_isotropic", "network": "network"}


def force_groups() -> tuple[TrialGroup, ...]:
    """The shipped hood, the muscles past it, then the variants."""
    both = (AN, MYOHAND)
    partners = {f"force ti {m}": f"force split {m}" for m in THROUGH_THE_HOOD}
    return (
        _group("two models: hood", "ti", THROUGH_THE_HOOD, both, partners=partners),
        _group("two models: flexors", "split", PAST_THE_HOOD, (MYOHAND,)),
        _group("two models: fixed split", "split", THROUGH_THE_HOOD, (MYOHAND,), variant=True),
        _group("two models: isotropic hood", "iso", THROUGH_THE_HOOD, both, variant=True),
        _group("two models: network", "network", THROUGH_THE_NETWORK, both, variant=True),
    )


def _group(
    name: str,
    law: str,
    muscles: Sequence[str],
    sources: Sequence[str],
    *,
    variant: bool = False,
    partners: dict[str, str] | None = None,
) -> TrialGroup:
    case = CASES.get(law, law)
    trials = tuple(
        Trial(f"force {law} {m}", f"{case}_{m.lower()}", (CLAMPED,), muscle=m) for m in muscles
    )
    targets = tuple(t for trial in trials for t in _targets(trial, sources))
    return TrialGroup(name, "published model", trials, targets, variant, partners or {})


def _targets(trial: Trial, sources: Sequence[str]) -> Iterator[Target]:
    for source in sources:
        vector = two_models()[trial.muscle][source]
        for component, value in zip(PRINTED, vector, strict=True):
            yield Target(
                f"{trial.name}: {component}, {source}",
                f"difference.fingertip_force_N.{component}",
                "N",
                value,
                None,
                None,
                None,
                source,
                "published model",
                trial.name,
                note="clamped",
            )


def two_models() -> dict[str, dict[str, tuple[float, float, float]]]:
    """Distal, palmar and radial force, N, by muscle and source."""
    out: dict[str, dict[str, tuple[float, float, float]]] = {}
    for row in (row.cells for row in packaged_rows("fingertip_two_models")):
        distal, palmar, radial = (float(row[axis]) for axis in PRINTED)
        vector = (distal, palmar, radial)
        out.setdefault(row["muscle"], {})[row["source"]] = vector
    return out


# Forces at the attachments, Dogadov et al. 2025 ---------------------------------------------------

ATTACHMENTS = {
    "attachment_force.distal": ("force of the terminal slip", "slip_force_N.terminal"),
    "attachment_ratio.middle_over_distal": (
        "central over terminal slip",
        "slip_force_N.central/slip_force_N.terminal",
    ),
}
PULLED = ("EDC", "UI", "RI", "LUM")
TOO_FAR = ("90/90/80",)
"""A posture beyond what our DIP reaches."""


def attachment_group() -> TrialGroup:
    """The slips' forces of a middle finger whose four tendons pull alike, beside a network model in
    its simplest form, without a hood."""
    trials: dict[str, Trial] = {}
    targets = []
    for m in read_measured("dogadov2025"):
        if m.posture in TOO_FAR:
            continue
        settings = (
            *posture_settings(*angles_of(m.posture)),
            'finger.tip.kind="posture"',
            *(f'tendons.{t}={{ tension = "{m.tension:g} N" }}' for t in PULLED),
        )
        name = f"attachments hood {m.posture} {m.tension:g} N"
        trials.setdefault(name, Trial(name, "hood_minorflex_edc", settings))
        words, quantity = ATTACHMENTS[m.quantity]
        place = (f"{name}: {words}", quantity, m.unit, m.number(), m.sd, None, None)
        note = "bones held; their network has no hood"
        targets.append(Target(*place, m.cited.cited, m.evidence, name, note=note))
    return TrialGroup(
        "Dogadov 2025: attachments", "published model", tuple(trials.values()), tuple(targets)
    )
