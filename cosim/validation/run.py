"""The validations: every trial run, every compared number with its verdict, misses included.

Why a compared number misses: what the sensitivity study found, beside the row that it explains.

`cases/data/validation_reasons.csv` has a line for each kind of miss: patterns of
the groups' and the rows' names (as of file names) and the reason, with the study's own figures.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import InputError, Progress, nearest_names, quiet, span
from cosim.files import clear_leftovers
from cosim.outcome import Outcome
from cosim.pipeline import plain_summary, run_cases
from cosim.processes import process_pool
from cosim.results.audit import describe_misses
from cosim.results.compare import Comparison, Kind, Target, Verdict, number, tally, write_json
from cosim.results.result import Result
from cosim.text_tables import packaged_rows
from cosim.validation.lengths import measure_lengths
from cosim.validation.plan import LEE_LOAD, MODULI, groups, rows_of, split_answers
from cosim.validation.skill import (
    FACTORS,
    HandGains,
    Hands,
    Noise,
    Skill,
    against_factors,
    hand_data,
    hands_headline,
    headline,
    judging_rows,
    scale_rows,
    skill,
)
from cosim.validation.trial import Summaries, Trial, TrialGroup
from fe_solver.febio.published_hood import qian_moduli, solve_published_hood

NOT_KNOWN = "not known"
MISSES: tuple[Verdict, ...] = ("outside", "no value")


class Reason(NamedTuple):
    """Why rows miss whose names are like `pattern`, in the groups whose names are like `group`."""

    group: str
    pattern: str
    text: str


@cache
def reasons() -> tuple[Reason, ...]:
    """Those of the packaged file, in its order."""
    rows = (row.cells for row in packaged_rows("validation_reasons"))
    return tuple(Reason(row["group"], row["pattern"], row["reason"]) for row in rows)


def reason_of(group: str, name: str) -> str | None:
    """The first that fits a row, None where there is none."""
    fits = (
        r.text for r in reasons() if fnmatchcase(group, r.group) and fnmatchcase(name, r.pattern)
    )
    return next(fits, None)


def explain_misses(group: str, rows: Iterable[Comparison]) -> Iterator[Comparison]:
    """The rows, those that miss with the reason in their note, or that none is known."""
    for row in rows:
        if row.verdict not in MISSES:
            yield row
            continue
        why = reason_of(group, row.target.name) or NOT_KNOWN
        note = "; ".join(part for part in (row.target.note, f"why: {why}") if part)
        yield replace(row, target=replace(row.target, note=note))


MODEL, SPLIT = "model", "fixed split"
"""The answer that is judged, and the null model that has no hood."""
Summary = Mapping[str, Any]


@dataclass(frozen=True)
class Board:
    """The rows of one group, the trials that failed, what the audits of others missed, and the
    skill of the model over its null models; where hands were measured one by one its gains hand by
    hand, and by unit the noise of their numbers."""

    group: str
    rows: tuple[Comparison, ...]
    failures: dict[str, str]
    audit_misses: Mapping[str, list[str]] = field(default_factory=dict)
    kind: Kind = "experiment"
    variant: bool = False
    skills: tuple[Skill, ...] = ()
    by_hand: tuple[HandGains, ...] = ()
    noise: Mapping[str, Noise] = field(default_factory=dict)
    split: Mapping[Target, float | None] = field(default_factory=dict)
    """The fixed split's answers."""
    hands: Hands = field(default_factory=dict)
    """What was measured in each hand, of the rows of which it is known."""

    @property
    def headline(self) -> str:
        """Whether the model beats its null models, and in how many hands it is nearer."""
        hands = f". Nearer hand by hand: {hands_headline(self.by_hand)}" if self.by_hand else ""
        return headline(self.skills, len(judging_rows(self.rows))) + hands

    @property
    def hand_lines(self) -> list[str]:
        """The gains hand by hand, and the noise, a line each."""
        noise = [
            f"noise: {number(n.single, 2)} {unit} on a hand, {number(n.mean, 2)} on their mean"
            for unit, n in self.noise.items()
        ]
        return [*map(str, self.by_hand), *noise]

    def answers(self) -> dict[str, list[Comparison]]:
        """The rows that count, with the numbers of the model and of each null model."""
        rows = judging_rows(self.rows)
        answers = {MODEL: rows}
        answers |= {null: scale_rows(rows, factor) for null, factor in FACTORS.items()}
        if self.split:
            mine = [r.target for r in rows if r.target in self.split]
            answers[SPLIT] = [Comparison(t, self.split[t]) for t in mine]
        return answers

    def tallies(self) -> dict[str, dict[str, int]]:
        """The tally of the rows that count, of the model and of each null model."""
        return {answer: tally(rows) for answer, rows in self.answers().items()}


def by_kind(boards: Sequence[Board]) -> list[Board]:
    """A board of each kind of reference that has rows which count, variants left out."""
    whole = []
    for kind in dict.fromkeys(b.kind for b in boards):
        mine = [b for b in boards if b.kind == kind and not b.variant]
        rows = tuple(judging_rows([row for b in mine for row in b.rows]))
        split = {t: value for b in mine for t, value in b.split.items()}
        hands = {t: values for b in mine for t, values in b.hands.items()}
        if rows:
            skills = _skills(rows, split, hands)
            whole.append(Board(kind, rows, {}, kind=kind, skills=skills, split=split, hands=hands))
    return whole


def choose_groups(only: str | None, published: Path | None = None) -> list[TrialGroup]:
    """The groups, or that of the name `only`, as `cosim validate --list` prints it, or of each the
    trials whose name holds `only`; with the `published` hood's file those on it as well.  Raises
    InputError for none."""
    every = groups(published)
    if only is None:
        return list(every)
    kept = []
    for group in every:
        is_named = only.strip() in (group.name, group.listed)
        trials = tuple(t for t in group.trials if is_named or only.strip() in t.name)
        if trials:
            kept.append(with_trials(group, trials))
    if not kept:
        names = {n for group in every for n in (group.name, *(t.name for t in group.trials))}
        near = nearest_names(only, sorted({*names, *" ".join(names).split()}), most=3)
        hint = f"; did you mean {' or '.join(near)}?" if near else "."
        raise InputError(
            f"{only!r}: no group or trial has this name{hint} `cosim validate --list` has all"
        )
    return kept


def with_trials(group: TrialGroup, trials: Sequence[Trial]) -> TrialGroup:
    """The group with some of its trials, and the targets of these."""
    names = {t.name for t in trials}
    targets = tuple(t for t in group.targets if t.case in names)
    return replace(group, trials=tuple(trials), targets=targets)


def run_validation(
    chosen_groups: Sequence[TrialGroup],
    folder: Path,
    settings: Sequence[str] = (),
    workers: int = 2,
    progress: Progress = quiet,
) -> list[Board]:
    """Run the trials of the groups, each once, leave a run folder of each in `folder` with its
    comparison, and compare.  Raises InputError."""
    trials = {t.name: t for g in chosen_groups for t in g.trials}
    if trials:
        progress(f"0 of {len(trials)}, in {min(workers, len(trials))} processes")
    ended = _outcomes(list(trials.values()), settings, folder, workers)
    outcomes = collect_outcomes(ended, len(trials), progress)
    boards = [board_of(group, outcomes) for group in chosen_groups]
    for name in trials:
        rows = [row for b in boards for row in b.rows if row.target.case == name]
        if rows and (folder / folder_name(name)).is_dir():
            write_json(folder / folder_name(name) / "comparison.json", rows)
    return boards


def collect_outcomes(
    ended: Iterable[tuple[str, Outcome[Summary]]], total: int, progress: Progress
) -> dict[str, Outcome[Summary]]:
    """The outcomes by name, with how long the others take as each ends.  Raises InputError where a
    case is refused."""
    outcomes: dict[str, Outcome[Summary]] = {}
    started = time.perf_counter()
    for name, outcome in ended:
        if outcome.status == "refused":
            outcome.result()
        outcomes[name] = outcome
        done, word = len(outcomes), f": {outcome.reason}" if outcome.error else ""
        left = (time.perf_counter() - started) / done * (total - done)
        progress(f"{done} of {total}, about {span(left)} left: {name}{word}")
    return outcomes


def _outcomes(
    trials: Sequence[Trial], settings: Sequence[str], folder: Path, workers: int
) -> Iterator[tuple[str, Outcome[Summary]]]:
    """The trials' names and outcomes as they end.  Raises InputError."""
    runs = [t for t in trials if not (t.study or t.published)]
    others = [t for t in trials if t not in runs]
    with process_pool(max(1, min(workers, len(others)))) as pool:
        yield from pool.in_order(partial(_solve_other, settings=tuple(settings)), others)
    cases = [_case(trial, settings) for trial in runs]
    clear_leftovers(folder)
    for i, outcome in run_cases(cases, partial(_save, folder=folder), workers):
        yield runs[i].name, outcome


def _case(trial: Trial, settings: Sequence[str]) -> Case:
    """The case of a trial, whose run is drawn where the settings say so.  Raises InputError."""
    case = load_case(trial.case, ["output.picture=false", *trial.settings, *settings])
    return case.model_copy(update={"name": folder_name(trial.name)})


def _solve_other(trial: Trial, settings: tuple[str, ...]) -> tuple[str, Outcome[Summary]]:
    """The outcome of a trial that is not the run of one case.  Raises InputError."""
    if trial.study:
        return trial.name, measure_lengths(trial.study, [*trial.settings, *settings])
    solved = solve_published_hood(trial.case, qian_moduli(MODULI[trial.published]), LEE_LOAD)
    return trial.name, Outcome("converged", solved.summary())


def _save(result: Result, folder: Path) -> Summary:
    result.save(folder)
    return plain_summary(result)


def folder_name(trial: str) -> str:
    """The trial's name as a folder's."""
    return "".join(c if c.isalnum() else "_" for c in trial)


def board_of(group: TrialGroup, outcomes: Mapping[str, Outcome[Summary]]) -> Board:
    """The board of a group whose trials ended so."""
    mine = {t.name: outcomes[t.name] for t in group.trials}
    summaries = {name: o.value for name, o in outcomes.items() if o.value is not None}
    rows = tuple(explain_misses(group.name, rows_of(group, summaries)))
    failures = {name: o.reason for name, o in mine.items() if o.error is not None}
    missed = {
        name: misses
        for name, o in mine.items()
        if o.value and (misses := list(describe_misses(o.value)))
    }
    split = split_answers(group, rows, summaries)
    by_hand, noise = compare_by_hand(group, summaries)
    hands = measured_by_hand(group, rows)
    return Board(
        group.name,
        rows,
        failures,
        missed,
        group.kind,
        group.variant,
        _skills(rows, split, hands),
        by_hand,
        noise,
        split,
        hands,
    )


def measured_by_hand(group: TrialGroup, rows: Sequence[Comparison]) -> dict[Target, list[float]]:
    """What was measured in each hand, by the rows' targets; of those that every hand has."""
    values: dict[tuple[str, str], list[float]] = {}
    for target in (t for hand in group.hands.values() for t in hand):
        if target.reference is not None:
            values.setdefault((target.case, target.quantity), []).append(target.reference)
    by_row = {r.target: values.get((r.target.case, r.target.quantity), []) for r in rows}
    return {t: hands for t, hands in by_row.items() if hands and len(hands) == len(group.hands)}


def compare_by_hand(
    group: TrialGroup, summaries: Summaries
) -> tuple[tuple[HandGains, ...], dict[str, Noise]]:
    """The gains over each null model, and the noise; none where hands are not known."""
    by_hand = {h: replace(group, targets=tuple(t), derived=None) for h, t in group.hands.items()}
    data = hand_data({hand: list(rows_of(of_hand, summaries)) for hand, of_hand in by_hand.items()})
    if data is None:
        return (), {}
    split = split_answers(by_hand[data.names[0]], data.rows, summaries)
    every = [*(data.gains(null) for null in FACTORS), data.gains(SPLIT, split) if split else None]
    return tuple(gains for gains in every if gains is not None), data.noise


def _skills(
    rows: Sequence[Comparison], split: Mapping[Target, float | None], hands: Hands
) -> tuple[Skill, ...]:
    over_split = skill(rows, SPLIT, split, hands) if split else None
    skills = [*against_factors(rows, hands), over_split]
    return tuple(s for s in skills if s is not None)
