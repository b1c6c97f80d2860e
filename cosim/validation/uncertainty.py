"""How sure a compared number is: V&V 20 of the ASME, with E = model - measurement.

u_val^2 = u_num^2 + u_input^2 + u_D^2: of the mesh (`cosim.validation.mesh`), of the model's inputs
(`cosim.validation.versions`) and of the measured mean, its SD over the root of the number of
specimens.  Expanded by Student's factor for 95 % with the degrees of freedom of u_D and u_input
(Welch and Satterthwaite), it bounds what |E| may be before the model's form is to blame.  A source
without an SD forms no u_val.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from math import hypot, inf, sqrt
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from cosim.analyses.mesh_series import MeshSeries
from cosim.results.compare import Comparison, number
from cosim.text_tables import read_json_file
from cosim.validation.records import Record, check_record
from cosim.validation.run import Board
from cosim.validation.versions import InputSpread, Key, key_of
from cosim.version import __version__

FILE = "uncertainty.json"
LEVEL = 0.95
SAME_NUMBER = 1e-3
"""A number that differs by more of itself is another than that whose uncertainty is known."""
Judgement = Literal["model differs", "within uncertainty", "not found", "no u_val"]
JUDGEMENTS: tuple[Judgement, ...] = get_args(Judgement)


class NumberUncertainty(Record):
    """What is known of one compared number; what was not looked at is None."""

    group: str
    case: str
    name: str
    quantity: str
    unit: str
    model: float
    meshes: MeshSeries | None = None
    inputs: InputSpread | None = None
    forms: Mapping[str, float | None] = {}
    """The number with other hoods, by their name."""

    @property
    def key(self) -> Key:
        """The number's key."""
        return self.group, self.case, self.name, self.quantity

    @property
    def u_num(self) -> float | None:
        """The standard uncertainty by the mesh."""
        return None if self.meshes is None else self.meshes.uncertainty

    @property
    def form_range(self) -> tuple[float, float] | None:
        """The least and the largest number of all forms, with the model's own."""
        known = [v for v in self.forms.values() if v is not None]
        return (min(*known, self.model), max(*known, self.model)) if known else None


class UncertaintyFile(Record):
    """What a validation found of its numbers' uncertainty."""

    format: Literal["cosim uncertainty 1"] = "cosim uncertainty 1"
    version: str = __version__
    meshes: tuple[float, ...] = ()
    """Quads over those of a case of the usual fineness; empty: none were tried."""
    samples: int = 0
    """How many samples of the inputs there were."""
    failed: Mapping[str, str] = {}
    """Trials without a result on another mesh, with another hood or at a sample, and why."""
    rows: tuple[NumberUncertainty, ...] = ()

    def by_key(self) -> dict[Key, NumberUncertainty]:
        """Its rows by their keys."""
        return {row.key: row for row in self.rows}


class Budget(NamedTuple):
    """The error of a row and what it is made of, in the row's unit; None: not known."""

    error: float | None
    u_num: float | None
    u_input: float | None
    u_data: float | None
    freedom: float
    """Degrees of freedom of u_val."""
    lacks: str
    """Why there is no u_val; empty where there is."""

    @property
    def u_model(self) -> float | None:
        """The model's own: mesh and inputs; None where both are not known."""
        if self.u_num is None or self.u_input is None:
            return None
        return hypot(self.u_num, self.u_input)

    @property
    def u_val(self) -> float | None:
        """The standard uncertainty of the error."""
        if self.u_model is None or self.u_data is None:
            return None
        return hypot(self.u_model, self.u_data)

    @property
    def factor(self) -> float:
        """Student's factor for 95 %."""
        from scipy.stats import norm, t

        upper = (1 + LEVEL) / 2
        law = norm if self.freedom == inf else t(max(self.freedom, 1.0))
        return float(law.ppf(upper))

    @property
    def expanded(self) -> float | None:
        """What |E| may be by uncertainty alone, at 95 %."""
        return None if self.u_val is None else self.factor * self.u_val

    @property
    def judgement(self) -> Judgement:
        """Whether the error is beyond the uncertainty; not found where the source would have told
        and the model has no number."""
        if self.error is None and self.u_data is not None:
            return "not found"
        if self.expanded is None or self.error is None:
            return "no u_val"
        return "within uncertainty" if abs(self.error) <= self.expanded else "model differs"


def budget(row: Comparison, known: NumberUncertainty | None) -> Budget:
    """The budget of a row."""
    t, error = row.target, row.difference
    u_num = None if known is None else known.u_num
    u_input = None if known is None or known.inputs is None else known.inputs.uncertainty
    u_data = None if t.sd is None else t.sd / sqrt(t.n or 1)
    parts = []
    if u_data is not None and t.n and t.n > 1:
        parts.append((u_data, t.n - 1.0))
    if u_input is not None and known is not None and known.inputs is not None:
        parts.append((u_input, known.inputs.samples - 1.0))
    total = hypot(*(u or 0.0 for u in (u_num, u_input, u_data)))
    below = sum(u**4 / freedom for u, freedom in parts)
    freedom = total**4 / below if below else inf
    return Budget(error, u_num, u_input, u_data, freedom, _lacks(row, known, u_num, u_input))


def _lacks(
    row: Comparison,
    known: NumberUncertainty | None,
    u_num: float | None,
    u_input: float | None,
) -> str:
    if row.model is None:
        return "the model has no number"
    lacking = []
    if row.target.sd is None:
        lacking.append("the source has no SD")
    if known is None:
        lacking.append("mesh and inputs were not varied")
    else:
        if u_num is None:
            lacking.append("no other mesh was tried")
        if u_input is None:
            lacking.append("the inputs were not varied")
    return "; ".join(lacking)


def known_of(board: Board, rows: Mapping[Key, NumberUncertainty]) -> dict[Key, NumberUncertainty]:
    """What is known of a board's numbers, as far as they are still those numbers."""
    known = {}
    for row in board.rows:
        key = key_of(board.group, row)
        found = rows.get(key)
        if found is None or row.model is None:
            continue
        if abs(found.model - row.model) <= SAME_NUMBER * max(abs(row.model), 1e-3):
            known[key] = found
    return known


def read_committed() -> UncertaintyFile:
    """What stands in `cases/uncertainty.json`.  Raises InputError."""
    return read_uncertainty(Path(str(resources.files("cases") / FILE)))


def read_uncertainty(path: Path) -> UncertaintyFile:
    """Read a file of uncertainties.  Raises InputError."""
    place = f"{path}: is no file of uncertainties"
    return check_record(UncertaintyFile, read_json_file(path), place)


def update(
    before: UncertaintyFile,
    boards: Sequence[Board],
    parts: Mapping[str, Mapping[Key, Any]] | None = None,
    failed: Mapping[str, str] | None = None,
    meshes: tuple[float, ...] = (),
    samples: int = 0,
) -> UncertaintyFile:
    """What is known of the boards' numbers with what was found anew: by the field of
    `NumberUncertainty` the values of it by number, and why trials had none."""
    rows, kept = before.by_key(), []
    for board in boards:
        old = known_of(board, rows)
        for row in board.rows:
            key = key_of(board.group, row)
            if row.model is None:
                continue
            known = old.get(key) or _nothing_known(key, row)
            found = {word: values[key] for word, values in (parts or {}).items() if key in values}
            if key in old or found:
                kept.append(known.model_copy(update={"model": row.model, **found}))
    return UncertaintyFile(
        meshes=meshes or before.meshes,
        samples=samples or before.samples,
        failed={**before.failed, **(failed or {})},
        rows=tuple(kept),
    )


def _nothing_known(key: Key, row: Comparison) -> NumberUncertainty:
    group, case, name, quantity = key
    unit, model = row.target.unit, row.model or 0.0
    return NumberUncertainty(
        group=group, case=case, name=name, quantity=quantity, unit=unit, model=model
    )


def sentence(row: Comparison, of_row: Budget) -> str:
    """A row's budget in words."""
    if of_row.judgement in ("no u_val", "not found"):
        return of_row.lacks or "no u_val"
    parts = (("mesh", of_row.u_num), ("inputs", of_row.u_input), ("data", of_row.u_data))
    shown = ", ".join(f"{word} {number(u, 2)}" for word, u in parts)
    return (
        f"E {number(of_row.error, 3)}, 95 % of u_val {number(of_row.expanded, 2)} "
        f"{row.target.unit} ({shown})"
    )
