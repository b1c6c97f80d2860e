"""The validations: every trial run, every compared number with its verdict, misses included."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import ConvergenceError, InputError, Progress, nearest_names, quiet, span
from cosim.files import output_file
from cosim.json_text import json_text
from cosim.models.fit import check_fit
from cosim.processes import process_pool
from cosim.results.audit import describe_misses
from cosim.results.compare import Comparison, Kind, Target, as_dict, number, tally, write_json
from cosim.results.static import observe_static
from cosim.solve.session import Session
from cosim.solve.solvers import solve
from cosim.validation.lengths import measure_lengths
from cosim.validation.plan import groups, rows_of, split_answers
from cosim.validation.published_hood import published_summary
from cosim.validation.reasons import explain_misses
from cosim.validation.skill import (
    FACTORS,
    HandGains,
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
from cosim.version import __version__

FORMAT = "cosim scoreboard 3"
SPLIT = "fixed split"
"""The null model that has no hood."""
Task = tuple[Trial, tuple[str, ...], str]
"""A trial, settings beside its own, and the folder for its run."""


@dataclass(frozen=True)
class ValidationOutcome:
    """What a trial said, or why it said nothing or not all."""

    trial: str
    summary: dict[str, Any] | None
    failure: str | None


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

    @property
    def headline(self) -> str:
        """Whether the model beats its null models, and hand by hand."""
        hands = f". Hand by hand {hands_headline(self.by_hand)}" if self.by_hand else ""
        return headline(self.skills, len(judging_rows(self.rows))) + hands

    @property
    def hand_lines(self) -> list[str]:
        """The gains hand by hand, and the noise, a line each."""
        noise = [
            f"noise: {number(n.single, 2)} {unit} on a hand, {number(n.mean, 2)} on their mean"
            for unit, n in self.noise.items()
        ]
        return [*map(str, self.by_hand), *noise]

    def tallies(self) -> dict[str, dict[str, int]]:
        """The tally of the rows that count, of the model and of each null model."""
        rows = judging_rows(self.rows)
        found = {"model": tally(rows)}
        found |= {null: tally(scale_rows(rows, factor)) for null, factor in FACTORS.items()}
        if self.split:
            mine = [r.target for r in rows if r.target in self.split]
            found[SPLIT] = tally([Comparison(t, self.split[t]) for t in mine])
        return found


def by_kind(boards: Sequence[Board]) -> list[Board]:
    """A board of each kind of reference that has rows which count, variants left out."""
    found = []
    for kind in dict.fromkeys(b.kind for b in boards):
        mine = [b for b in boards if b.kind == kind and not b.variant]
        rows = tuple(judging_rows([row for b in mine for row in b.rows]))
        split = {t: value for b in mine for t, value in b.split.items()}
        if rows:
            found.append(Board(kind, rows, {}, kind=kind, skills=_skills(rows, split), split=split))
    return found


def choose_groups(only: str | None, published: Path | None = None) -> list[TrialGroup]:
    """The groups, or of each the trials whose name holds `only`; with the `published` hood's file
    those on it as well.  Raises InputError for none."""
    every = groups(published)
    if only is None:
        return list(every)
    kept = []
    for group in every:
        trials = tuple(t for t in group.trials if only in t.name)
        names = {t.name for t in trials}
        if trials:
            targets = tuple(t for t in group.targets if t.case in names)
            kept.append(replace(group, trials=trials, targets=targets))
    if not kept:
        names = {t.name for group in every for t in group.trials}
        near = nearest_names(only, sorted({*names, *" ".join(names).split()}), most=3)
        hint = f"; did you mean {' or '.join(near)}?" if near else "."
        raise InputError(f"{only!r}: no trial is called so{hint} `cosim validate --list` has all")
    return kept


def run_validation(
    chosen_groups: Sequence[TrialGroup],
    folder: Path,
    settings: Sequence[str] = (),
    workers: int = 2,
    told: Progress = quiet,
) -> list[Board]:
    """Run the trials of the groups, each once, leave a run folder of each in `folder` with its
    comparison, and compare.  Raises InputError."""
    trials = {t.name: t for g in chosen_groups for t in g.trials}
    tasks = [(t, tuple(settings), str(folder)) for t in trials.values()]
    outcomes: dict[str, ValidationOutcome] = {}
    started = time.perf_counter()
    batches = _batches(tasks)
    if tasks:
        told(f"0 of {len(tasks)}, in {min(workers, len(batches))} processes")
    with process_pool(min(workers, len(batches))) as pool:
        for ended in pool.as_ended(_run_batch, [[batch] for batch in batches]):
            for outcome in ended:
                outcomes[outcome.trial] = outcome
                done, word = len(outcomes), f": {outcome.failure}" if outcome.failure else ""
                left = (time.perf_counter() - started) / done * (len(tasks) - done)
                told(f"{done} of {len(tasks)}, about {span(left)} left: {outcome.trial}{word}")
    boards = [_board(group, outcomes) for group in chosen_groups]
    for name in trials:
        own = [row for b in boards for row in b.rows if row.target.case == name]
        if own and (folder / folder_name(name)).is_dir():
            write_json(folder / folder_name(name) / "comparison.json", own)
    return boards


def _batches(tasks: Sequence[Task]) -> list[list[Task]]:
    """The tasks whose cases share an unloaded equilibrium, which one process solves but once, in
    one batch each, the largest first."""
    found: dict[str, list[Task]] = {}
    for task in tasks:
        key = task[0].name if task[0].is_published or task[0].study else _case(task).setting_key()
        found.setdefault(key, []).append(task)
    return sorted(found.values(), key=len, reverse=True)


def _case(task: Task) -> Case:
    """Raises InputError."""
    trial, settings, _ = task
    case = load_case(trial.case, [*trial.settings, *settings])
    return case.model_copy(update={"name": folder_name(trial.name)})


def _run_batch(batch: Sequence[Task]) -> list[ValidationOutcome]:
    session = Session()
    return [_run(task, session) for task in batch]


def _run(task: Task, session: Session) -> ValidationOutcome:
    trial, settings, folder = task
    started = time.perf_counter()
    if trial.study:
        return ValidationOutcome(
            trial.name, *measure_lengths(trial.study, [*trial.settings, *settings])
        )
    if trial.is_published:
        return ValidationOutcome(trial.name, published_summary(trial), None)
    case = _case(task)
    check_fit(case)
    try:
        models, states = solve(case, session)
    except ConvergenceError as error:
        return ValidationOutcome(trial.name, None, str(error))
    made = observe_static(case, (models, states), time.perf_counter() - started)
    made.save(folder)
    return ValidationOutcome(trial.name, json.loads(json_text(made.summary)), None)


def folder_name(trial: str) -> str:
    """The trial's name as a folder's."""
    return "".join(c if c.isalnum() else "_" for c in trial)


def _board(group: TrialGroup, outcomes: Mapping[str, ValidationOutcome]) -> Board:
    mine = [outcomes[t.name] for t in group.trials]
    summaries = {o.trial: o.summary for o in outcomes.values() if o.summary is not None}
    rows = tuple(explain_misses(group.name, rows_of(group, summaries)))
    failures = {o.trial: o.failure for o in mine if o.failure is not None}
    missed = {
        o.trial: found for o in mine if o.summary and (found := list(describe_misses(o.summary)))
    }
    split = split_answers(group, rows, summaries)
    by_hand, noise = _by_hand(group, summaries)
    return Board(
        group.name,
        rows,
        failures,
        missed,
        group.kind,
        group.variant,
        _skills(rows, split),
        by_hand,
        noise,
        split,
    )


def _by_hand(
    group: TrialGroup, summaries: Summaries
) -> tuple[tuple[HandGains, ...], dict[str, Noise]]:
    """The gains over each null model, and the noise; none where hands are not known."""
    own = {h: replace(group, targets=tuple(t), derived=None) for h, t in group.hands.items()}
    data = hand_data({hand: list(rows_of(of_hand, summaries)) for hand, of_hand in own.items()})
    if data is None:
        return (), {}
    split = split_answers(own[data.names[0]], data.rows, summaries)
    found = [*(data.gains(null) for null in FACTORS), data.gains(SPLIT, split) if split else None]
    return tuple(gains for gains in found if gains is not None), data.noise


def _skills(rows: Sequence[Comparison], split: Mapping[Target, float | None]) -> tuple[Skill, ...]:
    found = [*against_factors(rows), skill(rows, SPLIT, split) if split else None]
    return tuple(s for s in found if s is not None)


def scoreboard(boards: Sequence[Board]) -> str:
    """The text of the file: the same rows give the same bytes."""
    content = {
        "format": FORMAT,
        "version": __version__,
        "kinds": {b.group: _judge(b) for b in by_kind(boards)},
        "judged": {b.group: _judge(b) for b in boards},
        "failed": {name: why for b in boards for name, why in b.failures.items()},
        "groups": {b.group: [_round_digits(row) for row in b.rows] for b in boards},
    }
    return json_text(content) + "\n"


def _judge(board: Board) -> dict[str, Any]:
    return {
        "headline": board.headline,
        "kind": board.kind,
        "variant": board.variant,
        "tally": board.tallies(),
        "skill": [_skill(s) for s in board.skills],
        "by_hand": [_hand_gains(gains) for gains in board.by_hand],
        "noise": {unit: _rounded(noise._asdict()) for unit, noise in board.noise.items()},
    }


def _skill(found: Skill) -> dict[str, Any]:
    """Skill to four decimals: a ratio of sums, near 1 at best; null where it is minus infinity."""
    values = {"skill": found.value, "low": found.low, "high": found.high}
    numbers = {k: round(v, 4) if v is not None and isfinite(v) else None for k, v in values.items()}
    counts = {"rows": found.rows, "trials": found.trials}
    return {"null": found.null, **numbers, "fault": found.fault, **counts}


def _hand_gains(found: HandGains) -> dict[str, Any]:
    resamples = {f"{' '.join(r.hands)} ({r.ways})": r.gain for r in found.resamples}
    return {
        "null": found.null,
        "verdict": found.verdict,
        "gain": _rounded(found.gains),
        "without": _rounded(found.without),
        "resamples": _rounded(resamples),
        "perfect_skill": round(found.perfect, 4),
    }


def _rounded(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in numbers.items()}


def _round_digits(row: Comparison) -> dict[str, Any]:
    """Six digits are more than the models are good for, and hide the last bits of a machine, which
    a difference of almost equal numbers would show: it is that of the numbers as they are told."""
    numbers = {k: six_digits(getattr(row.target, k)) for k in ("reference", "sd", "low", "high")}
    told = Comparison(replace(row.target, **numbers), six_digits(row.model))
    return {k: six_digits(v) for k, v in as_dict(told).items()}


def six_digits(value: Any) -> Any:
    """A float to six digits, anything else as it is."""
    return float(f"{value:.6g}") if isinstance(value, float) else value


def write_scoreboard(path: Path, boards: Sequence[Board]) -> None:
    """Raises InputError where the file cannot be written."""
    with output_file(path) as part:
        part.write_text(scoreboard(boards), encoding="utf-8")
