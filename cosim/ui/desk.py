"""What a page shows and what it was asked: one state on the server, which every tab of it shares.

Changes come from the tabs, in any order and number; `solving` has the newest solved, and `saving`
writes what is shown.
"""

from __future__ import annotations

import tomllib
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from threading import Condition, RLock
from typing import Any, Literal

from cosim.analyses.ladder import case_on_rung, rungs_of
from cosim.case.file import case_of, load_case, packaged_cases
from cosim.case.schema import Case, check_name
from cosim.case.usual import unusual_values
from cosim.errors import ConvergenceError, CosimError, InputError, ResidualText, StoppedError
from cosim.files import shown_path, temporary_folder
from cosim.models.fit import check_fit
from cosim.outcome import one_line
from cosim.processes import ProcessEndedError
from cosim.report.views import View, limits, pack_views
from cosim.results.answer import answer as answer_in_words
from cosim.results.answer import doubts
from cosim.results.compare import unit_of, value_of
from cosim.results.quantities import key_quantities
from cosim.results.result import Result
from cosim.solve.motion import SolvedMotion
from cosim.ui.controls import (
    Control,
    changed_case,
    control_at_fault,
    controls_of,
    rungs_in_words,
)
from cosim.ui.saving import case_file_text, save_run, write_page_report
from cosim.ui.solving import Answer, Request, SoFar, Solving, answer_of, motion_so_far

Status = Literal["solving", "done", "at fault", "failed", "stopped", "waiting"]
"""`at fault`: a value cannot be solved with; `failed`: no equilibrium was found; `waiting`: a
motion, which is solved when it is asked for."""
ALIKE = 1e-4
"""Relative difference of two answers, to which they are the same equilibrium."""
MOST_RESIDUALS = 400
MOST_TEXT = 2_000_000
"""Characters of a case that a tab may send."""
WAIT = 600.0
"""s that saving waits for the solve to end."""
ADVICE = "Go back to the last value, or take smaller steps towards this one."


@dataclass(frozen=True)
class Shown:
    """What the page shows: of which request, and how sure it is."""

    request: Request
    answer: Answer
    note: str = ""
    is_checked: bool = False


@dataclass(frozen=True)
class Pin:
    """A run that was pinned, to compare others with."""

    label: str
    answer: Answer


class Desk:
    """One case on the page, its changes, and its answer.

    `out`: the folder in which runs are saved.  `reduced`: the case with a reduced hood (`cosim
    reduce`), which is solved while a slider moves.  `is_live`: changes are solved in a process of
    its own; else the page watches a run, which says what to show by `hear`, `show` and `fail`."""

    def __init__(
        self, case: Case, out: Path, reduced: Case | None = None, is_live: bool = True
    ) -> None:
        self._out, self._reduced, self._is_live = out, reduced, is_live
        self._lock = RLock()
        self._changed = Condition(self._lock)
        self._listeners: list[Callable[[], None]] = []
        self._solving = Solving(self, self._changed) if is_live else None
        self._room = temporary_folder("cosim-ui")
        self._folder = Path(self._room.name)
        self._version, self._picture, self._number, self._closed = 0, 0, 0, False
        self._shown: Shown | None = None
        self._so_far: View | None = None
        self._pin: Pin | None = None
        self._saved, self._has_report = "", False
        self._residuals: deque[tuple[str, float]] = deque(maxlen=MOST_RESIDUALS)
        self._opened = 0
        self._stated = self._base = case
        self._controls: tuple[Control, ...] = ()
        with self._lock:
            self._begin(case)
        if self._solving is not None:
            self._solving.start()

    # --- what the tabs ask for

    def change(self, key: str, text: str, is_drag: bool = False) -> None:
        """Put a text in place of a control's value.  Raises InputError for a key without one."""
        with self._lock:
            self._check_live()
            control = next((c for c in self._controls if c.key == key), None)
            if control is None or len(text) > 200:
                raise InputError(f"{key[:60]!r}: no control of this case")
            if text == control.text:
                self._changes.pop(key, None)
            else:
                self._changes[key] = text
            self._ask(is_drag)

    def reset(self) -> None:
        """Take all changes back."""
        with self._lock:
            self._check_live()
            self._changes.clear()
            self._ask()

    def choose_hood(self, rung: str) -> None:
        """Put the hood of a rung of the ladder in place of the case's own; changes of controls that
        both have stay.  Raises InputError."""
        with self._lock:
            self._check_live()
            if rung not in rungs_of(self._stated):
                raise InputError(f"{rung[:60]!r}: no hood of the ladder")
            self._base = case_on_rung(self._stated, rung)
            self._rung = rung
            self._controls = controls_of(self._base)
            self._ask()

    def open_packaged(self, name: str) -> None:
        """Begin with a packaged case.  Raises InputError."""
        self._check_live()
        if name not in packaged_cases():
            raise InputError(f"{name[:60]!r}: no packaged case")
        self._open(load_case(name))

    def open_text(self, name: str, text: str) -> None:
        """Begin with a case that a tab sends; paths in it are relative to the working directory.
        Raises InputError."""
        self._check_live()
        stem = check_name(Path(name.replace("\\", "/")).name.removesuffix(".toml"))
        if len(text) > MOST_TEXT:
            raise InputError(f"{stem}: is larger than a case file ({len(text)} characters)")
        try:
            table = tomllib.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{stem}.toml: is not valid TOML: {error}") from None
        self._open(case_of(table, stem))

    def solve(self) -> None:
        """Solve what the controls say: of a motion, or after a stop."""
        with self._lock:
            self._check_live()
            self._ask(is_asked=True)

    def stop(self) -> None:
        """Stop the solve that runs; what is shown stays."""
        with self._lock:
            self._check_live()
            self._number += 1
            self._drop()
            if self._status == "solving":
                self._tell("stopped")

    def pin(self) -> None:
        """Keep the answer that is shown beside those that follow.  Raises InputError."""
        with self._lock:
            if self._shown is None:
                raise InputError("there is no result yet to pin")
            self._pin = Pin(self._shown.request.label, self._shown.answer)
            self._picture += 1
            self._publish()

    def unpin(self) -> None:
        """Let the pinned answer go."""
        with self._lock:
            self._pin = None
            self._picture += 1
            self._publish()

    def save(self) -> str:
        """Write the run that is shown to the output folder; where it is.  Waits for a solve that
        runs.  Raises InputError where there is none, or the folder cannot be written."""
        shown = self._settled()
        name = self._free_name(shown.request.case.name)
        folder = save_run(shown.answer.result, name, self._out)
        with self._lock:
            self._saved = f"The run is in {shown_path(folder)}."
            self._publish()
        return self._saved

    def report(self) -> Path:
        """Write the report of the run that is shown, beside the pinned one; its file.  Waits for a
        solve that runs.  Raises InputError."""
        shown = self._settled()
        with self._lock:
            pin = self._pin
        is_same = pin is None or pin.answer is shown.answer
        pinned = None if pin is None or is_same else pin.answer.result
        name = shown.request.case.name
        return write_page_report(self._folder, name, shown.answer.result, pinned)

    def case_text(self) -> tuple[str, str]:
        """The name of a case file and its text, TOML: what the page states now.  Raises
        InputError."""
        with self._lock:
            case, changes, is_own = self._case(), dict(self._changes), self._base is self._stated
            stated = self._stated
        name = case.name + ("_changed" if changes or not is_own else "")
        return name, case_file_text(case, stated, changes if is_own else None)

    # --- what a run that is watched says

    def hear(self, message: Any) -> None:
        """Take a stage in words, or the frames of a motion so far."""
        with self._lock:
            match message:
                case SoFar(view):
                    self._so_far = view
                    self._picture += 1
                case str():
                    self._stage = str(message)
                    if isinstance(message, ResidualText):
                        self._residuals.append((message.state, message.residual))
            self._publish()

    def show_motion(self, case: Case, so_far: SolvedMotion) -> None:
        """Show a motion on its way."""
        self.hear(motion_so_far(case, so_far))

    def show(self, result: Result) -> None:
        """Show the result of the run that is watched."""
        found = answer_of(result)
        with self._lock:
            request = Request(self._number, self._base, self._base.name, "from rest")
            self.take(request, found)

    def fail(self, error: CosimError) -> None:
        """Say how the run that is watched failed."""
        with self._lock:
            self._tell("failed", one_line(error))

    # --- what the tabs show

    def listen(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call the listener after every change of the state; returns what ends that."""
        with self._lock:
            self._listeners.append(listener)

        def end() -> None:
            with self._lock, suppress(ValueError):
                self._listeners.remove(listener)

        return end

    @property
    def version(self) -> int:
        """A number that grows with every change of the state."""
        return self._version

    @property
    def is_closed(self) -> bool:
        """Whether the page ends."""
        return self._closed

    def state(self) -> dict[str, Any]:
        """All but the controls and what is drawn, for JSON."""
        with self._lock:
            shown, pin = self._shown, self._pin
            summary = {} if shown is None else shown.answer.result.summary
            return {
                "version": self._version,
                "picture": self._picture,
                "isLive": self._is_live,
                "case": self._base.name,
                "title": self._base.title,
                "isMotion": self._base.task == "motion",
                "rung": self._rung,
                "rungs": self._rungs,
                "controls": f"{self._base.name} {self._rung} {self._opened}",
                "changes": self._changes,
                "faults": self._faults,
                "otherFaults": self._other_faults,
                "unusual": self._unusual,
                "status": self._status,
                "stage": self._stage,
                "residuals": [*self._residuals],
                "error": self._error,
                "answer": None
                if shown is None
                else {
                    "isCurrent": shown.request.number == self._number,
                    "isReduced": shown.request.is_reduced,
                    "isChecked": shown.is_checked,
                    "note": shown.note,
                    "label": shown.request.label,
                    "words": answer_in_words(summary),
                    "seconds": summary.get("wall_s"),
                },
                "isSoFar": self._so_far is not None,
                "strip": self._strip(),
                "warnings": [*map(str, summary.get("warnings", ())), *doubts(summary)],
                "pin": None if pin is None else pin.label,
                "saved": self._saved,
                "out": shown_path(self._out),
            }

    def controls(self) -> list[dict[str, Any]]:
        """The controls of the case, for JSON."""
        with self._lock:
            return [asdict(control) for control in self._controls]

    def drawn(self) -> dict[str, Any]:
        """What is drawn, as scene.js takes it: the answer or the motion so far, then the pinned
        answer."""
        with self._lock:
            views = [] if self._shown is None else [self._shown.answer.view]
            if self._so_far is not None:
                views = [self._so_far]
            if views and self._pin is not None:
                views.append(self._pin.answer.view)
            packed = pack_views(views, [limits(views)] * len(views)) if views else {"views": []}
            return {**packed, "picture": self._picture}

    def close(self) -> None:
        """End the process that solves, and remove what was kept."""
        with self._lock:
            self._closed = True
            self._publish()
        if self._solving is not None:
            self._solving.close()
        self._room.cleanup()

    # --- inside

    def _begin(self, case: Case) -> None:
        self._stated = self._base = case
        self._opened += 1
        self._rung = case.hood.rung()
        self._rungs = rungs_in_words(case)
        self._controls = controls_of(case) if self._is_live else ()
        self._changes: dict[str, str] = {}
        self._faults: dict[str, list[str]] = {}
        self._other_faults: list[str] = []
        self._unusual: list[str] = []
        self._status: Status = "solving"
        self._stage = self._error = self._saved = ""
        self._shown = self._so_far = self._pin = None
        self._picture += 1
        if self._is_live:
            self._ask()

    def _open(self, case: Case) -> None:
        with self._lock:
            self._begin(case)

    def _check_live(self) -> None:
        if not self._is_live:
            raise InputError("this page watches a run; `cosim ui` has a page to work in")

    def _case(self) -> Case:
        """The case that the page states.  Raises InputError."""
        keys = {control.key for control in self._controls}
        return changed_case(self._base, {k: t for k, t in self._changes.items() if k in keys})

    def _ask(self, is_drag: bool = False, is_asked: bool = False) -> None:
        """Have what the controls say solved, or say what is wrong with it."""
        self._number += 1
        self._faults, self._other_faults, self._unusual = {}, [], []
        try:
            case = self._case()
            check_fit(case)
        except InputError as error:
            self._drop()
            self._place_faults(error)
            self._tell("at fault")
            return
        self._unusual = [*unusual_values(case), *case.dropped]
        if case.task == "motion" and not is_asked:
            self._drop()
            self._tell("waiting")
            return
        request = Request(self._number, case, self._label(), is_drag=is_drag)
        if self._solving is not None:
            self._solving.put(self._with_reduced_hood(request) if is_drag else request)
        self._tell("solving")

    def _drop(self) -> None:
        if self._solving is not None:
            self._solving.drop()

    def _with_reduced_hood(self, request: Request) -> Request:
        """The request with the reduced hood in place of the full one, where there is one and only
        posture and tendons were changed."""
        if self._reduced is None or self._base is not self._stated:
            return request
        known = {control.key for control in controls_of(self._reduced)}
        if not known.issuperset(self._changes):
            return request
        try:
            case = changed_case(self._reduced, self._changes)
        except InputError:
            return request
        return replace(request, case=case, is_reduced=True)

    def check_wanted(self) -> Request | None:
        """The request that solves what is shown once more, from rest; None where none is due."""
        shown = self._shown
        if shown is None or shown.is_checked or shown.note:
            return None
        request = shown.request
        is_due = request.number == self._number and not request.is_reduced
        if not is_due or request.case.task == "motion":
            return None
        return replace(request, start="from rest", is_check=True)

    def is_stale(self, request: Request) -> bool:
        """Whether nobody waits for a request."""
        return request.number != self._number and not request.is_drag

    def begin(self, request: Request) -> None:
        """Forget the residuals of the solve before."""
        if not request.is_check:
            self._residuals.clear()

    def take(self, request: Request, found: Answer) -> None:
        """Show an answer, unless it is older than what is shown."""
        if request.is_check:
            self._confirm(request, found)
            return
        last = self._shown
        if last is not None and last.request.number > request.number:
            return
        is_last = request.number == self._number
        if not is_last and not request.is_drag:
            return
        is_sure = request.start == "from rest" or request.case.task == "motion"
        self._shown, self._so_far = Shown(request, found, is_checked=is_sure), None
        self._picture += 1
        if is_last:
            self._tell("done")
        else:
            self._publish()

    def _confirm(self, request: Request, found: Answer) -> None:
        shown = self._shown
        if shown is None or request.number != self._number:
            return
        note = "" if _is_alike(shown.answer.result, found.result) else OTHER
        self._shown = replace(shown, answer=found, note=note, is_checked=True)
        self._picture += bool(note)
        self._publish()

    def fail_request(self, request: Request, error: CosimError) -> None:
        """Say how a solve failed, unless nobody waits for it."""
        with self._lock:
            if self._closed or request.number != self._number:
                return
            self._so_far = None
            if request.is_check and self._shown is not None:
                self._shown = replace(self._shown, note=ALONE)
                self._publish()
                return
            match error:
                case StoppedError():
                    return
                case ProcessEndedError():
                    self._tell("failed", f"{one_line(error)}. The next change starts it anew.")
                case InputError():
                    self._place_faults(error)
                    self._tell("at fault")
                case ConvergenceError():
                    self._tell("failed", f"{one_line(error)} {ADVICE}")
                case _:
                    self._tell("failed", one_line(error))

    def _place_faults(self, error: InputError) -> None:
        """Say each fault at its control, those without one above them all."""
        for fault in error.faults:
            self._place_fault(fault.place, fault.message)
        if not error.faults:
            place, colon, message = str(error).partition(": ")
            is_key = bool(colon) and " " not in place
            self._place_fault(place if is_key else "", message if is_key else str(error))

    def _place_fault(self, place: str, message: str) -> None:
        key = control_at_fault(place, self._controls)
        if key:
            self._faults.setdefault(key, []).append(message)
        else:
            self._other_faults.append(f"{place}: {message}" if place else message)

    def _label(self) -> str:
        """The case, and what is changed in it."""
        changes = [c.words(t) for c in self._controls if (t := self._changes.get(c.key))]
        words = [self._rung_word(), *changes] if self._base is not self._stated else changes
        more = f", {len(words) - 2} more" if len(words) > 2 else ""
        return f"{self._base.name}: {', '.join(words[:2]) or 'as it is'}{more}"

    def _rung_word(self) -> str:
        return next((r["label"] for r in self._rungs if r["name"] == self._rung), self._rung)

    def _strip(self) -> list[dict[str, Any]]:
        """The numbers that one asks for first, now and of the pinned run."""
        if self._shown is None:
            return []
        now = self._shown.answer.result.summary
        pinned = {} if self._pin is None else self._pin.answer.result.summary
        rows = {path: label for label, path in (*key_quantities(now), *key_quantities(pinned))}
        return [
            {
                "path": path,
                "label": label,
                "unit": unit_of(path),
                "now": value_of(now, path),
                "pinned": value_of(pinned, path) if pinned else None,
            }
            for path, label in rows.items()
        ]

    def _settled(self) -> Shown:
        """What is shown once no solve runs.  Raises InputError where there is nothing current."""
        with self._lock:
            self._changed.wait_for(self._is_settled, WAIT)
            shown = self._shown
            if shown is None or shown.request.number != self._number or shown.request.is_reduced:
                raise InputError("there is no result of what the controls say now")
            return shown

    def _is_settled(self) -> bool:
        is_solving = self._solving is not None and self._solving.is_busy
        busy = is_solving or self._status == "solving" or self.check_wanted() is not None
        return self._closed or not busy

    def _free_name(self, name: str) -> str:
        name += "_changed" if self._changes or self._base is not self._stated else ""
        names = (name if n == 1 else f"{name}_{n}" for n in range(1, 10_000))
        return next(n for n in names if not (self._out / n).exists())

    def _tell(self, status: Status, error: str = "") -> None:
        self._status, self._error = status, error
        if status != "solving":
            self._stage = ""
        self._publish()

    def _publish(self) -> None:
        self._version += 1
        self._changed.notify_all()
        for listener in self._listeners:
            listener()


OTHER = (
    "This hood has more than one equilibrium here: solved from rest, as `cosim run` does, it came "
    "to another one than from the last values. Shown is the one from rest."
)
ALONE = (
    "Solved from rest, as `cosim run` does, no equilibrium was found; this one was reached from "
    "the last values."
)


def _is_alike(one: Result, other: Result) -> bool:
    """Whether two results of a case have the same forces at the fingertip and in the slips."""
    a, b = ({**{f"tip {k}": v for k, v in r.tip_force.items()}, **r.slips} for r in (one, other))
    scale = max((abs(v) for v in b.values()), default=0.0) or 1.0
    return all(abs(a.get(name, 0.0) - value) <= ALIKE * scale for name, value in b.items())
