"""What a report says in sentences: the question, the answer, how to make the run again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.fingers.kinds import FINGERS
from cosim.hoods.kinds import KINDS
from cosim.report.tables import last_ledger
from cosim.results import answer as answers
from cosim.results.compare import Comparison, number, tally
from cosim.results.load_and_rest import describe_rest
from cosim.results.result import Result

TIPS = {
    "point": "held at a point, free to turn",
    "clamped": "clamped: it carries a moment too",
    "free": "free",
    "posture": "free, with every joint held in its posture",
    "cage": "a sphere in a cage of six walls",
    "shell": "a sphere in a hollow sphere",
}
SCHEMES = {
    "linear": "solved together (the hood's tangent in the finger's Newton iteration)",
    "newton": "solved together (Newton's method)",
    "implicit": "solved together (fixed point, accelerated)",
    "explicit": "one after the other in every step, staggered",
    "jacobi": "side by side in every step",
    "one_way": "one way: the hood is solved once and its forces handed to the finger once",
}
PULLS = {"activation", "tension", "excursion", "signal"}
"""What a case says of a tendon that it pulls."""


def question(run: Result) -> list[tuple[str, str]]:
    """What was asked, from the case: heading and words."""
    finger, hood = _table(run.case_table, "finger"), _table(run.case_table, "hood")
    tip = str(_table(finger, "tip").get("kind", "free"))
    posture = ", ".join(
        f"{joint.replace('_', ' ')} {angle}" for joint, angle in _table(finger, "posture").items()
    )
    kind = str(hood.get("kind", ""))
    quads = run.summary.get("hood_quads")
    sheet = f" ({quads} quads)" if quads else ""
    facts = [
        ("Finger", _title(FINGERS, str(finger.get("kind")))),
        ("Posture", posture),
        ("Fingertip", TIPS.get(tip, tip)),
        ("Pulled", tendon_pulls(run) or "no tendon beyond its resting tension"),
        ("Hood", _title(KINDS, kind) + sheet),
        ("Lesion", _lesion(run.case_table)),
        ("Hood and finger", _scheme(run.case_table, kind)),
        ("Time", _time(run.case_table)),
        ("Notes", str(run.case_table.get("notes", ""))),
    ]
    return [(head, text) for head, text in facts if text]


def _title(kinds: Mapping[str, Any], kind: str) -> str:
    """A finger or hood in words; of a kind that this version does not know its name."""
    return str(kinds[kind].table.title) if kind in kinds else kind


def _lesion(table: Mapping[str, Any]) -> str:
    lesion = _table(table, "lesion")
    parts = [f"{name} cut" for name in lesion.get("cut", ())]
    parts += [f"{name} grown onto the bone" for name in lesion.get("adhere", ())]
    parts += [f"{name} {less} shorter" for name, less in _table(lesion, "shorten").items()]
    return ", ".join(parts).replace("_", " ")


def _scheme(table: Mapping[str, Any], hood: str) -> str:
    if hood in KINDS and not KINDS[hood].table.is_coupled:
        return ""
    scheme = str(_table(table, "coupling").get("scheme", "linear"))
    return SCHEMES.get(scheme, scheme)


def _time(table: Mapping[str, Any]) -> str:
    forward = _table(table, "forward")
    if not forward:
        relaxation = _table(table, "relaxation")
        cycles, held = _table(relaxation, "cycles"), relaxation.get("held")
        more = f", held for {held} while parts relax" if held else ""
        more = f", the last of {cycles['count']} loads" if cycles else more
        return f"an equilibrium, at rest and loaded{more}"
    return f"a motion of {forward.get('duration', '')} in steps of {forward.get('step', '')}"


def tendon_pulls(run: Result) -> str:
    """The tendons that the case pulls, with their tensions at the end."""
    tensions = run.summary.get("tension_N", {})
    named = [
        name
        for name, tendon in _table(run.case_table, "tendons").items()
        if PULLS & set(tendon) and name in tensions
    ]
    pulls = ", ".join(f"{name} with {number(tensions[name])} N" for name in named)
    return f"{pulls} at the end" if pulls and run.axis == "time" else pulls


def _table(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = table.get(key, {})
    return value if isinstance(value, Mapping) else {}


def answer(run: Result) -> str:
    """What came out, in a few sentences."""
    return " ".join(answers.answer(run.summary))


def rest(run: Result) -> list[str]:
    """What there is at rest beside what the load changes, a sentence for each quantity; or why
    that is not judged."""
    return [f"{name[0].upper()}{name[1:]}: {text}." for name, text in describe_rest(run.summary)]


def trust(run: Result) -> str:
    """What the audit found."""
    return answers.trust(run.summary)


def closure(run: Result) -> str:
    """How nearly the forces on each bone add up to zero; nothing of a run whose finger does not
    tell all its forces."""
    sums = {
        body: np.sum(list(wrenches.values()), axis=0) for body, wrenches in last_ledger(run).items()
    }
    if not sums or "not_in_ledger" in run.summary:
        return ""
    force = max(float(np.linalg.norm(wrench[:3])) for wrench in sums.values())
    moment = max(float(np.linalg.norm(wrench[3:])) for wrench in sums.values())
    most = f"{number(force, 2)} N and {number(1e3 * moment, 2)} N mm".replace("-", "−")
    return f"On each bone they add up to zero within {most}; the ground holds the first."


def doubts(run: Result) -> Iterator[str]:
    """What a reader must know before believing a number."""
    return answers.doubts(run.summary)


def warnings(runs: Sequence[Result]) -> Iterator[str]:
    """What the runs warn of, with the run's name where there are several."""
    for run in runs:
        name = f"{run.name}: " if len(runs) > 1 else ""
        for warning in run.summary.get("warnings", ()):
            yield f"Warning: {name}{warning}"


def score(rows: Sequence[Comparison]) -> str:
    """How many rows came out how, misses first to be seen."""
    if not rows:
        return ""
    count = tally(rows)
    counts = ", ".join(f"{n} {name}" for name, n in count.items())
    word = "row" if len(rows) == 1 else "rows"
    return f"{len(rows)} {word}: {counts}"


def commands(runs: Sequence[Result], against: Result | None) -> str:
    """The lines that make the runs and this report again, from the cases saved beside."""
    every = [*runs, against] if against is not None else [*runs]
    versions = [run.summary.get("version", "?") for run in every]
    lines = [f"# cosim-hand {version}" for version in dict.fromkeys(versions)]
    lines += [f"cosim run {run.case}.toml --out runs{_folder(run)}" for run in every]
    last = f" --against {_place(against)}" if against is not None else ""
    data = " --data FILE.csv" if any(run.comparison for run in every) else ""
    lines.append(f"cosim show {' '.join(map(_place, runs))}{last}{data} -o report.html")
    return "\n".join(lines)


def _folder(run: Result) -> str:
    """The folder below `runs` that tells runs of one name apart."""
    above = run.name.rpartition("/")[0]
    return f"/{above}" if above else ""


def _place(run: Result) -> str:
    return f"runs{_folder(run)}/{run.case}"
