"""What is claimed of the model's credibility, and the evidence: `cases/data/credibility.toml`.

A factor has a grade, and evidence by its address: `file PATH`, `test PATH::NAME`, `command COSIM
...`, `board GROUP` of the scoreboard, or `uncertainty PART` of the uncertainties.  Where evidence
is lacking its grade counts as 0.  What the evidence covers, posture by muscle, follows from the
trials of the board and from the collection of measurements.
"""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib import resources
from math import degrees
from pathlib import Path
from string import ascii_lowercase
from typing import Any, Literal, NamedTuple, Self

from pydantic import model_validator

from cosim.case.file import load_case, packaged_cases
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fingers.kinds import native
from cosim.measured import Measured, all_measured
from cosim.results.compare import number
from cosim.text_tables import read_json_file, read_toml
from cosim.validation.mesh import distinct, tally
from cosim.validation.plan import groups
from cosim.validation.records import Record, check_record
from cosim.validation.trial import Trial, TrialGroup
from cosim.validation.uncertainty import UncertaintyFile, read_committed

CASES = Path(str(resources.files("cases")))
CHECKOUT = CASES.parent
"""Files and tests of evidence are in it, where it is one."""
MISSES = ("outside", "no value")
Words = Literal["file", "test", "command", "board", "uncertainty"]
Parts = Literal["meshes", "inputs", "forms", "judged"]


class Factor(Record):
    """One of the 13 factors of V&V 40."""

    activity: str
    name: str
    grades: tuple[str, ...]
    """What each grade means, from 0 on."""
    grade: int
    """What we give ourselves."""
    goal: int
    """What the risk asks for."""
    why: str
    evidence: tuple[str, ...]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not 0 <= self.grade < len(self.grades) or not 0 <= self.goal < len(self.grades):
            raise ValueError(f"{self.name}: grade and goal must be one of {len(self.grades)}")
        return self


class Rule(Record):
    """One of the Ten Rules."""

    name: str
    grade: int
    """0 to 4."""
    why: str
    evidence: tuple[str, ...]


class Rules(Record):
    """The Ten Rules, where they are from and what their grades mean."""

    source: str
    seen: str
    scale: tuple[str, ...]
    list: tuple[Rule, ...]


class EvidenceKind(Record):
    """A kind of evidence of FDA's guidance, and whether there is any."""

    name: str
    have: Literal["yes", "in part", "no"]
    what: str
    evidence: tuple[str, ...]


class Guidance(Record):
    """FDA's guidance."""

    source: str
    url: str
    seen: str
    words: str
    kinds: tuple[EvidenceKind, ...]


class Risk(Record):
    """How much hangs on the model's word."""

    influence: str
    influence_why: str
    consequence: str
    consequence_why: str
    risk: str
    why: str


class Step(Record):
    """What one types to repeat the evidence."""

    what: str
    command: str


class Credibility(Record):
    """The claims as their file states them."""

    question: str
    context: str
    outside: tuple[str, ...]
    risk: Risk
    factors: tuple[Factor, ...]
    fda: Guidance
    rules: Rules
    repeat: tuple[Step, ...]


class Evidence(NamedTuple):
    """An address followed."""

    kind: str
    what: str
    """What it names."""
    found: str
    """What stands there in words: of a board its tally; empty where there is nothing to add."""
    fault: str = ""
    """Why it is none."""


class Numbers(NamedTuple):
    """What the evidence is read from."""

    board: Mapping[str, Any]
    """`cases/scoreboard.json`."""
    uncertainty: UncertaintyFile


def read_credibility(path: Path = CASES / "data" / "credibility.toml") -> Credibility:
    """The claims of a file.  Raises InputError."""
    return check_record(Credibility, read_toml(path), path)


def committed_numbers() -> Numbers:
    """The committed board and uncertainties.  Raises InputError."""
    board = read_json_file(CASES / "scoreboard.json")
    if "groups" not in board or "judged" not in board:
        raise InputError(f"{CASES / 'scoreboard.json'}: is no scoreboard of `cosim validate`")
    return Numbers(board, read_committed())


def counted(grade: int, evidence: Sequence[Evidence]) -> int:
    """The grade that counts: 0 where there is no evidence, or some of it is lacking."""
    return 0 if not evidence or any(e.fault for e in evidence) else grade


def follow(addresses: Iterable[str], numbers: Numbers) -> list[Evidence]:
    """What stands at addresses of evidence."""
    return [_follow(*address.partition(" ")[::2], numbers) for address in addresses]


def _follow(kind: str, what: str, numbers: Numbers) -> Evidence:
    match kind:
        case "file" | "test":
            return Evidence(kind, what, "", _file_fault(what) if is_checkout() else "")
        case "command":
            fault = "" if shlex.split(what)[:1] == ["cosim"] else "is no command of cosim"
            return Evidence(kind, what, "", fault)
        case "board":
            if what not in numbers.board["groups"]:
                return Evidence(kind, what, "", "the board has no such group")
            return Evidence(kind, what, board_words(what, numbers.board))
        case "uncertainty":
            fault = uncertainty_part(what, numbers).fault
            return Evidence(kind, what, uncertainty_words(what, numbers), fault)
    return Evidence(kind, what, "", "is no address of evidence")


def is_checkout() -> bool:
    """Whether the tests are here, to which evidence leads."""
    return (CHECKOUT / "tests").is_dir()


def _file_fault(what: str) -> str:
    place, _, name = what.partition("::")
    path = CHECKOUT / place
    if not path.is_file():
        return "there is no such file"
    if name and not re.search(rf"^ *def {re.escape(name)}\(", path.read_text("utf-8"), re.M):
        return "the file has no such test"
    return ""


def board_words(group: str, board: Mapping[str, Any]) -> str:
    """A group's verdicts, and the skill over no answer."""
    judged = board["judged"][group]
    tally = ", ".join(f"{count} {word}" for word, count in judged["tally"]["model"].items())
    skills = [s["skill"] for s in judged["skill"] if s["null"] == "no answer"]
    skill = f"; skill over no answer {number(skills[0], 2)}" if skills and skills[0] else ""
    rows = board["groups"][group]
    return f"{tally or f'{len(rows)} numbers, none counts'}{skill}"


class Part(NamedTuple):
    """A part of the uncertainty of the compared numbers."""

    known: int
    """Of how many numbers it is known."""
    of: int
    words: str

    @property
    def fault(self) -> str:
        """Why it is no evidence; empty where it is."""
        if not self.known:
            return "no number has it yet"
        return "" if 2 * self.known >= self.of else "fewer than half of the numbers have it"


def uncertainty_part(part: str, numbers: Numbers) -> Part:
    """A part of the uncertainty of the shipped models' numbers: `meshes`, `inputs`, `forms`, or
    `judged`, the errors of experiments beside their uncertainty."""
    known, judged = numbers.uncertainty, numbers.board["judged"]
    rows = [row for row in known.rows if not judged.get(row.group, {}).get("variant")]
    of = len(rows)
    match part:
        case "meshes":
            series = {row.key: row.meshes for row in rows if row.meshes is not None}
            touched = [one for _, one in distinct(series)]
            observed = sum(one.convergence.order is not None for one in touched)
            words = (
                f"on {len(known.meshes)} meshes; of {len(touched)} that the mesh touches an order "
                f"is observed for {observed}, {tally(series)['beyond']} show none and change by "
                "more than they may"
            )
            return Part(len(series), of, words)
        case "inputs":
            count = sum(row.inputs is not None for row in rows)
            return Part(count, of, f"at {known.samples} samples of the inputs")
        case "forms":
            return Part(sum(bool(row.forms) for row in rows), of, "with other hoods")
        case "judged":
            every = [row for _, row in judged_rows(numbers.board)]
            words_of = Counter(str(r.get("judgement")) for r in every if r["sd"] is not None)
            known_words = {w: n for w, n in words_of.items() if w not in ("no u_val", "None")}
            words = ", ".join(f"{n} {word}" for word, n in known_words.items())
            return Part(sum(known_words.values()), sum(words_of.values()), words)
    return Part(0, 0, "")


def uncertainty_words(part: str, numbers: Numbers) -> str:
    """How many numbers have a part of the uncertainty, and what it says."""
    count, of, words = found = uncertainty_part(part, numbers)
    which = "numbers with an SD:" if part == "judged" else "numbers"
    return f"{count} of {of} {which} {words}" if found.known else ""


def judged_rows(board: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """The group and row of every number that counts beside an experiment, variants left out."""
    for group, rows in board["groups"].items():
        judged = board["judged"].get(group, {})
        if judged.get("variant") or not str(judged.get("kind")).startswith("experiment"):
            continue
        yield from ((group, r) for r in rows if not r["fitted"] and r["kind"] != "requirement")


class Covered(NamedTuple):
    """What of a finger's posture and muscle is compared with a measurement."""

    finger: str
    posture: tuple[float, float, float]
    """MCP, PIP and DIP, deg."""
    tip: str
    """How the fingertip is held."""
    muscle: str
    tensions: tuple[float, ...]
    """N, of its trials."""
    hands: tuple[int, ...]
    """How many stand behind each number of a source, where it says."""
    verdicts: Mapping[str, int]
    """Of the compared numbers; empty where the collection has numbers and the board has none."""
    groups: tuple[str, ...]
    """Of the board, or sources of the collection."""

    @property
    def shape(self) -> str:
        """The worst of it, as on the board."""
        judged = sum(self.verdicts.get(v, 0) for v in ("inside 1 SD", "inside the band", *MISSES))
        missed = sum(self.verdicts.get(v, 0) for v in MISSES)
        if not self.verdicts:
            return "◇"
        if not judged:
            return "○"
        return "●" if not missed else "▲" if missed == judged else "◐"


SHAPES = {
    "●": "every number with a spread or a band is inside",
    "◐": "some are outside",
    "▲": "all are outside",
    "○": "compared, but the source prints no spread to judge by",
    "◇": "measured, and not compared on the board",
}
"""What the shapes of the coverage mean."""


def coverage(numbers: Numbers) -> list[Covered]:
    """What is compared, by finger, posture and muscle, and after it what the collection has
    besides.  Raises InputError."""
    found: dict[Place, list[_Compared]] = {}
    for group in groups():
        if not group.variant and group.kind.startswith("experiment"):
            for trial in group.trials:
                for place, compared in _compared(group, trial, numbers.board):
                    found.setdefault(place, []).append(compared)
    board = [_joined(place, parts) for place, parts in found.items()]
    return sorted([*board, *_uncompared(set(found))], key=lambda c: (c.finger, c.posture, c.tip))


class _Compared(NamedTuple):
    tension: float
    hands: int | None
    verdicts: Counter[str]
    group: str


Place = tuple[str, tuple[float, float, float], str, str]
TIPS = {"clamped": "clamped", "point": "held at a point", "free": "free", "posture": "bones held"}


def _compared(
    group: TrialGroup, trial: Trial, board: Mapping[str, Any]
) -> Iterator[tuple[Place, _Compared]]:
    """What a trial of one run compares."""
    rows = [r for g, r in judged_rows(board) if g == group.name and r["case"] == trial.name]
    if trial.study or trial.is_published or not rows:
        return
    case = load_case(trial.case, trial.settings)
    hands = max((n for r in rows if (n := hands_of(r["source"]))), default=None)
    verdicts = Counter(str(r["verdict"]) for r in rows)
    tip = native(case.finger).tip.kind
    for muscle, tension in pulled(case).items():
        compared = _Compared(tension, hands, verdicts, group.name)
        yield (case.finger.kind, posture_of(case), TIPS.get(tip, tip), muscle), compared


@cache
def hands_of(source: str) -> int | None:
    """How many specimens a source of a row measured, as the collection has it."""
    name = source.partition(",")[0]
    rows = (m for m in all_measured() if m.cited.cited.partition(",")[0] == name)
    return max((m.n for m in rows if m.n), default=None)


def pulled(case: Case) -> dict[str, float]:
    """The muscles that a case loads, with their tensions (N); parts of one, which end in a small
    letter, together."""
    tensions: dict[str, float] = {}
    for tendon in case.tendons:
        if (force := case.tension(tendon)) > case.solve.resting_tension:
            muscle = tendon.rstrip(ascii_lowercase)
            tensions[muscle] = tensions.get(muscle, 0.0) + force
    return tensions


def posture_of(case: Case) -> tuple[float, float, float]:
    """Flexion of MCP, PIP and DIP, deg."""
    angles = native(case.finger).posture.angles()
    mcp, pip, dip = (float(round(degrees(angles[joint]))) for joint in ("MCP", "PIP", "DIP"))
    return mcp, pip, dip


def _joined(place: Place, parts: Sequence[_Compared]) -> Covered:
    verdicts: Counter[str] = sum((p.verdicts for p in parts), Counter())
    tensions = tuple(sorted({float(f"{p.tension:.3g}") for p in parts}))
    hands = tuple(sorted({p.hands for p in parts if p.hands}))
    return Covered(*place, tensions, hands, verdicts, tuple(dict.fromkeys(p.group for p in parts)))


def _uncompared(compared: set[Place]) -> Iterator[Covered]:
    """What experiments of the collection measured at a posture under a muscle that no trial has."""
    known = {(finger, posture, muscle) for finger, posture, _, muscle in compared}
    found: dict[Place, list[Measured]] = {}
    for m in all_measured():
        if m.is_measured and m.muscle and m.angles and (m.finger, m.angles, m.muscle) not in known:
            tip = TIPS["clamped"] if "clamped" in m.fixture else m.fixture
            found.setdefault((m.finger, m.angles, tip, m.muscle), []).append(m)
    for place, rows in found.items():
        tensions = tuple(sorted({m.tension for m in rows if m.tension}))
        hands = tuple(sorted({m.n for m in rows if m.n}))
        cited = dict.fromkeys(m.cited.cited for m in rows)
        yield Covered(*place, tensions, hands, {}, tuple(cited))


def injuries(numbers: Numbers) -> tuple[list[Mapping[str, Any]], list[str]]:
    """The rows of the board on lengths and cuts, and the titles of the cases of injuries beside
    which nothing was measured."""
    of_studies = {(g.name, t.name) for g in groups() for t in g.trials if t.study}
    rows = [r for g, r in judged_rows(numbers.board) if (g, r["case"]) in of_studies]
    trials = {t.case for g in groups() for t in g.trials}
    cases = [(n, p) for n, p in packaged_cases().items() if p.parent.name == "lesion"]
    return rows, [str(read_toml(path)["title"]) for name, path in cases if name not in trials]
