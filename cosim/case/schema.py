"""What a case may say: its tables, names, units and ranges.  All values are SI once parsed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from cosim.case.faults import describe, listing
from cosim.case.layers import Layer, add_layer, dropped_keys, nested
from cosim.case.relaxation import RelaxationConfig
from cosim.errors import InputError
from cosim.files import shown_path
from cosim.fingers.common import stamps
from cosim.fingers.kinds import AnyFinger, NativeFinger, native
from cosim.hoods.give_way import GiveWayConfig, PartName
from cosim.hoods.kinds import AnyHood, unfit_lesion
from cosim.hoods.lesion import LesionConfig
from cosim.schema import units
from cosim.schema.fields import check_texts, fault, quantity
from cosim.schema.types import Count, Number, Switch, Table, TendonName
from cosim.tendons.table import TendonConfig

Task = Literal["static", "one_way", "motion"]
MOST_NAME = 200
"""Bytes of a case's name: a folder's may have 255, and a run is written beside its own."""

NEARBY_TOLERANCES = 1e-9, 1e-11
"""The coupling's and the hood's, with which two ways to an equilibrium agree to some 1e-9 of its
forces; the coupling comes to no smaller residual than some ten times the hood's."""


class SolveConfig(Table):
    """Tolerances: of the coupling (relative residual) and of the hood's own equilibrium; and how
    long a solve may take."""

    resting_tension: Annotated[float, quantity(units.FORCE, least="0 N", most="10 N")] = 0.05
    """Tension of every tendon that the case does not name, and of all tendons in the unloaded
    state."""
    tolerance: Annotated[Number, Field(ge=1e-14, le=1e-2)] = 1e-8
    """Coupled equilibrium: largest residual over the largest tension."""
    max_iterations: Annotated[Count, Field(ge=1, le=1000)] = 50
    """Iterations of the coupled equilibrium; a solve that needs more fails."""
    hood_tolerance: Annotated[Number, Field(ge=1e-14, le=1e-2)] = 1e-10
    """The hood's own equilibrium: largest residual over the largest force."""
    second_start: Switch = False
    """Solve the loaded equilibrium a second time, by the other scheme and from the hood as it is
    laid, and hold the one to the other: whether there are two; the result then carries both.  Of an
    equilibrium alone."""
    start: Literal["laid", "nearby"] = "laid"
    """Where an equilibrium begins: at the hood as it is laid, or in a study or batch at the last
    one that its process solved on a hood of as many nodes, which takes half of the time.  The
    tolerances are 1e-9 and the hood's 1e-11 then, so that both ways agree to some 1e-9 of the
    forces; a tenth of the runs goes both ways, and the audit is missed where they differ."""
    patience: Annotated[float, quantity(units.PATIENCE, above="0 s", most="1e7 s")] | None = None
    """Longest time of computing; a run that takes longer ends as one that does not converge and
    says how far it came, and a motion keeps what it reached.  Without it there is no limit."""

    @property
    def tolerances(self) -> tuple[float, float]:
        """The coupling's and the hood's, no larger than NEARBY_TOLERANCES where it begins near
        by."""
        coupling, hood = NEARBY_TOLERANCES if self.start == "nearby" else (np.inf, np.inf)
        return min(self.tolerance, coupling), min(self.hood_tolerance, hood)


class OneWayConfig(Table):
    """What a one-way pass hands to the finger, and what acts there beside it.  As it stands: the
    hood's wrenches and nothing twice; `cases/base/thesis_one_way.toml` has the other choices."""

    lumping: Literal["bodies", "centre_of_mass"] = "bodies"
    """Wrenches where they act, or each phalanx's force alone at its centre of mass: no moment."""
    joint_contact: Literal["none", "distal", "proximal"] = "none"
    """The force that the joint at this end of each phalanx passes on while the bones stand still is
    handed over too: a bone's net reaction holds such forces, and the finger makes them itself."""
    muscles: Switch = True
    """The finger's own tendons pull."""
    passive: Switch = True
    """The finger's own passive joint torques act; its limits always do."""


class CouplingConfig(Table):
    """How finger and hood come to agree.  Of an equilibrium: by Newton's method ("newton", which
    "linear" is there too), by a fixed point that asks for no derivatives ("implicit", with
    `accelerator`), or not at all ("one_way": the hood is solved once, in the posture).  Of a
    motion, a step at a time: linearly implicit ("linear": one hood solve a step), "newton",
    "implicit", staggered ("explicit") or side by side ("jacobi")."""

    scheme: Literal["linear", "newton", "implicit", "explicit", "jacobi", "one_way"] = "linear"
    """How hood and finger come to agree; "linear" is Newton's method in an equilibrium."""
    accelerator: Literal["constant", "aitken", "iqn_ils"] = "aitken"
    """Relaxation of the fixed point, with scheme = "implicit"."""
    tolerance: Annotated[float, quantity(units.ANGLE, above="0 deg", most="1 deg")] = 1e-9
    """The tolerance of the joint angles, in the iterated schemes."""
    one_way: OneWayConfig = OneWayConfig()
    """What the hood hands over, with scheme = "one_way"."""
    allow_double_counting: Switch = False
    """Run even where the hood hands over a force that the finger makes too."""

    @model_validator(mode="after")
    def _check_one_way(self) -> CouplingConfig:
        if self.scheme != "one_way" and self.one_way != OneWayConfig():
            raise fault('has a table one_way, which needs scheme = "one_way" alone')
        return self


class AdaptiveConfig(Table):
    """Steps whose length follows from their error: that of a joint angle in a step, estimated by
    the difference of two halves and a whole step, is at most `tolerance`.  A step that would have
    to be shorter than `floor` stops the run."""

    tolerance: Annotated[float, quantity(units.ANGLE, above="0 deg", most="10 deg")]
    """Largest error of a joint angle in one step."""
    floor: Annotated[float, quantity(units.TIME, least="1e-9 s", most="0.1 s")] = 1e-6
    """Shortest step; an error that asks for a shorter one ends the run."""


class ForwardConfig(Table):
    """A motion in time from rest in the posture, in place of an equilibrium: the tensions or
    activations act from the start on."""

    duration: Annotated[float, quantity(units.TIME, above="0 s", most="1000 s")] = 2.0
    """Simulated time, a whole number of steps."""
    step: Annotated[float, quantity(units.TIME, least="1e-6 s", most="0.1 s")] = 1e-3
    """Length of every step; with `adaptive` of the first and the longest."""
    adaptive: AdaptiveConfig | None = None
    """Lets the length of a step follow from its error; without it all steps are equal."""
    must_rest: Switch = True
    """The audit is missed where the finger is still moving at the end."""
    checkpoint: Annotated[Count, Field(ge=0, le=1_000_000)] | None = None
    """Steps from one checkpoint to the next; without it one is written every
    ten seconds of computing; 0: none."""

    @model_validator(mode="after")
    def _whole_steps(self) -> ForwardConfig:
        steps = round(self.duration / self.step)
        if steps < 1 or abs(steps * self.step - self.duration) > 1e-9 * self.duration:
            raise fault("its duration must be a multiple of the step")
        if self.adaptive is not None and self.adaptive.floor > self.step:
            raise fault("adaptive.floor must not be above the step, which is the longest")
        return self


class OutputConfig(Table):
    """What is written besides the numbers."""

    picture: Switch = True
    """Draw picture.png, ledger.png and, of a motion, history.png."""
    frames: Annotated[Count, Field(ge=0, le=1000)] = 50
    """Shapes of the hood kept over a motion, besides its start."""


class CaseFile(Table):
    """A case as its files state it."""

    title: str
    """The case in one line, for tables and reports."""
    notes: str | None = None
    """What else a reader needs to know; it changes no number."""
    finger: Annotated[AnyFinger, Field(discriminator="kind")]
    """The finger: its kind, posture, joints and fingertip."""
    tendons: dict[TendonName, TendonConfig] = Field(default_factory=dict)
    """What pulls each tendon; one that is not named has the resting tension."""
    hood: Annotated[AnyHood, Field(discriminator="kind")]
    """The extensor hood: its kind and what that kind is made of."""
    lesion: LesionConfig | None = None
    """An injury of the hood or its repair; without it the hood is intact."""
    gives_way: dict[PartName, GiveWayConfig] | None = None
    """When parts of the hood give way or begin to act, by the names that results give them."""
    relaxation: RelaxationConfig | None = None
    """What relaxes under load; without it nothing does."""
    solve: SolveConfig = SolveConfig()
    """Tolerances, and the tension at rest."""
    forward: ForwardConfig | None = None
    """A motion in time in place of an equilibrium."""
    coupling: CouplingConfig = CouplingConfig()
    """How finger and hood come to agree."""
    output: OutputConfig = OutputConfig()
    """What is written besides summary, arrays and ledger."""

    @model_validator(mode="before")
    @classmethod
    def _can_be_written(cls, values: Any) -> Any:
        check_texts(values)
        return values

    @model_validator(mode="after")
    def _can_be_injured(self) -> CaseFile:
        if wrong := self.unfit_lesion():
            raise fault(wrong)
        return self

    @model_validator(mode="after")
    def _can_give_way(self) -> CaseFile:
        if self.gives_way is None:
            return self
        if not self.gives_way:
            raise fault("gives_way: is empty; name a part, or leave the table out")
        contact = getattr(self.hood, "contact", None)
        if not self.hood.lies_on_bones or contact is None:
            raise fault(
                f'gives_way: a hood of kind "{self.hood.kind}" has no springs that could; "shell" '
                'and "cable" have'
            )
        if self.hood.has_friction or contact.penetration is not None:
            raise fault(
                "gives_way: is not solved with augmented contact; leave out hood.contact.friction "
                "and hood.contact.penetration"
            )
        if self.coupling.scheme == "one_way":
            raise fault('gives_way: is of a coupled hood; leave out coupling.scheme = "one_way"')
        if self.forward is None:
            for name, when in self.gives_way.items():
                if all(end is None for end in (when.force, when.stretch, when.energy)):
                    raise fault(
                        f"gives_way.{name}: time and begins are of a motion; write force, stretch "
                        "or energy, or a table forward"
                    )
        return self

    @model_validator(mode="after")
    def _can_wear(self) -> CaseFile:
        if self.forward is not None:
            return self
        for joint, splint in getattr(self.finger, "splint", {}).items():
            if splint.has_times:
                raise fault(
                    f"finger.splint.{joint}: begins and ends are of a motion; leave them out, or "
                    "write a table forward"
                )
        return self

    @model_validator(mode="after")
    def _can_relax(self) -> CaseFile:
        stated = self.relaxation
        if stated is None:
            return self
        if self.coupling.scheme == "one_way":
            raise fault('relaxation: is of a coupled hood; leave out coupling.scheme = "one_way"')
        lasts = (stated.held is not None) + (stated.cycles is not None)
        if self.forward is None and lasts != 1:
            raise fault(
                'relaxation: needs held or cycles in an equilibrium, for example held = "240 s"'
            )
        if self.forward is not None and lasts:
            raise fault(
                "relaxation: held and cycles are of an equilibrium; a motion has its own time"
            )
        if wrong := self.unfit_relaxation():
            raise fault(wrong)
        drawn = (t.excursion is not None and t.elastic is not None for t in self.tendons.values())
        if stated.tendons is not None and not any(drawn):
            raise fault(
                "relaxation.tendons: no tendon of the case has an excursion and is elastic; leave "
                "it out"
            )
        if stated.tendons is not None and stated.cycles is not None:
            raise fault("relaxation.tendons: is not solved with cycles; write held")
        if stated.joints is not None and not getattr(self.finger, "passive", None):
            raise fault("relaxation.joints: the finger has no passive joints; leave it out")
        return self

    @model_validator(mode="after")
    def _can_start_again(self) -> CaseFile:
        if self.solve.second_start and (
            self.forward is not None or self.coupling.scheme == "one_way"
        ):
            raise fault(
                "solve.second_start: a second start is of a coupled equilibrium; leave out "
                'forward and coupling.scheme = "one_way", or write false'
            )
        return self

    @model_validator(mode="after")
    def _can_start_nearby(self) -> CaseFile:
        stated = self.forward, self.relaxation, self.coupling.scheme == "one_way" or None
        if self.solve.start == "nearby" and (stated != (None,) * 3 or self.hood.has_friction):
            raise fault(
                'solve.start = "nearby": is of a coupled equilibrium that does not depend on its '
                "path; leave out forward, relaxation, one_way and friction of the hood, or the key"
            )
        return self

    def unfit_relaxation(self) -> str:
        """Why this hood cannot relax as the case says; empty where it can, or does not."""
        if self.relaxation is None or self.relaxation.hood is None:
            return ""
        contact = getattr(self.hood, "contact", None)
        if not self.hood.lies_on_bones or contact is None:
            return (
                f'relaxation.hood: a hood of kind "{self.hood.kind}" does not relax; "shell" and '
                '"cable" do'
            )
        if self.hood.has_friction or contact.penetration is not None:
            return (
                "relaxation.hood: is not solved with augmented contact; leave out "
                "hood.contact.friction and hood.contact.penetration"
            )
        given = self.gives_way or {}
        if given and self.forward is not None:
            return "relaxation.hood: what relaxes does not give way in a motion; leave one out"
        if any(when.stretch or when.energy for when in given.values()):
            return "relaxation.hood: what relaxes gives way at a force alone; state that"
        return ""

    def unfit_lesion(self) -> str:
        """Why this hood cannot have the lesion; empty where it can, or there is none."""
        return "" if self.lesion is None else unfit_lesion(self.hood, self.hood.kind, self.lesion)


def as_stated(value: Any) -> Any:
    """A value as a case file would state it: a quantity of pint as text with its unit, or as a
    number where it has none (a part, a per cent), numpy's numbers and arrays as Python's.

    >>> import numpy as np
    >>> as_stated(np.arange(2)), as_stated(np.bool_(True))
    ([0, 1], True)
    """
    if hasattr(value, "to_root_units"):
        root = value.to_root_units()
        if root.unitless:
            return as_stated(root.magnitude)
        if hasattr(value.magnitude, "__len__"):
            return [as_stated(part) for part in value]
        return f"{value:~}".replace(" ** ", "**")
    match value:
        case np.generic() | np.ndarray():
            return value.tolist()
        case Mapping():
            return {key: as_stated(part) for key, part in value.items()}
        case list() | tuple():
            return [*map(as_stated, value)]
    return value


def _is_text(value: object) -> bool:
    match value:
        case str():
            return True
    return False


def check_name(name: object) -> str:
    """The name of a case, which a folder of results gets.  Raises InputError."""
    text = str(name) if _is_text(name) else ""
    wrong = any(c in '/\\:*?"<>|' or ord(c) < 32 or "\ud800" <= c <= "\udfff" for c in text)
    if wrong or not text.strip(". ") or len(text.encode(errors="replace")) > MOST_NAME:
        raise InputError(
            f"name = {ascii(name)[:60]}: expected a name that a folder can have, of at most "
            f'{MOST_NAME} bytes and without / \\ : * ? " < > |'
        )
    return text


class Case(CaseFile):
    """A checked case: SI floats, angles in rad, paths absolute."""

    name: str
    """The file's stem."""
    source: Path
    dropped: tuple[str, ...] = Field(default=(), exclude=True)
    """What layers took away that no layer names, a sentence each."""

    @classmethod
    def from_layers(cls, layers: Sequence[Layer], source: Path) -> Case:
        """The case that layers make, each on top of those before, as a file `source` states it.

        Raises InputError that lists every fault with its place and what to write instead."""
        steps: list[dict[str, Any]] = [{}]
        merged = steps[0]
        try:
            for _, layer in layers:
                merged = add_layer(merged, layer)
                steps.append(merged)
            checked = CaseFile.model_validate(merged)
        except ValidationError as error:
            faults, count = describe(error, CaseFile, merged, layers)
            text = listing(shown_path(source), [*map(str, faults)], count)
            raise InputError(text, faults) from None
        except RecursionError:
            raise InputError(f"{shown_path(source)}: tables are nested too deeply") from None
        dropped = tuple(dropped_keys(steps))
        return cls.model_construct(
            name=source.stem, source=source, dropped=dropped, **dict(checked)
        )

    def replace(self, values: Mapping[str, Any], name: str | None = None) -> Case:
        """The case with other values by dotted key: texts with units as in a case file, pint's
        quantities, or bare numbers where the key has no unit.

        >>> import cosim
        >>> stiffer = cosim.load("isometric_edc").replace({"hood.mesh.quads": 250})
        >>> stiffer.hood.mesh.quads
        250

        Raises InputError that lists every fault with its place and what to write instead."""
        is_table = hasattr(values, "items") and not isinstance(values, type)
        if not is_table or not all(map(_is_text, values)):
            raise InputError(
                f'replace: expected values by dotted key, for example {{"hood.mesh.quads": 250}}, '
                f"not {ascii(values)[:60]}"
            )
        more = [("replace", nested(key, as_stated(value))) for key, value in values.items()]
        changed = self.with_layers(more)
        return changed if name is None else changed.model_copy(update={"name": check_name(name)})

    def with_layers(self, layers: Sequence[Layer]) -> Case:
        """The case with layers on top.  Raises InputError."""
        values = self.model_dump(mode="json", exclude={"name", "source"}, exclude_none=True)
        changed = Case.from_layers([(self.name, values), *layers], self.source)
        dropped = (*self.dropped, *changed.dropped)
        return changed.model_copy(update={"name": self.name, "dropped": dropped})

    @property
    def task(self) -> Task:
        """What is to be solved."""
        if self.forward is not None:
            return "motion"
        return "one_way" if self.coupling.scheme == "one_way" else "static"

    def tension(self, tendon: str) -> float:
        """The tension of a tendon (N); the resting tension where the case says nothing else."""
        stated = self.tendons.get(tendon, TendonConfig()).force
        return self.solve.resting_tension if stated is None else stated

    def rubbing_tendons(self) -> dict[str, TendonConfig]:
        """The tendons for which the case states friction."""
        return {name: t for name, t in self.tendons.items() if t.friction is not None}

    def setting_key(self) -> str:
        """A text that two cases share if and only if they differ in nothing but name and what pulls
        the tendons; a file that they read counts with its time and size."""
        shared = {"finger", "hood", "lesion", "solve", "coupling"}
        parts = self.model_dump(mode="json", include=shared)
        if rubbing := self.rubbing_tendons():
            parts["friction"] = [[n, t.friction, t.sliding] for n, t in rubbing.items()]
        files = (*self.finger.files(), *self.hood.files())
        return json.dumps([parts, stamps(files)], sort_keys=True)

    def hood_key(self) -> str:
        """A text that two cases share only if they differ in nothing but name, tendons (their
        friction too) and what holds the fingertip, so that one hood serves both."""
        parts, files = json.loads(self.setting_key())
        parts["finger"].pop("tip", None)
        parts.pop("friction", None)
        return json.dumps([parts, files], sort_keys=True)

    def mesh_key(self) -> str:
        """A text that two cases share only where their hood is laid out alike, before any lesion; a
        file that they read counts with its time and size."""
        return f"{self.hood.mesh_key()} {self.finger.anatomy_key()}"

    def without_lesion(self) -> Case:
        """The case with an intact hood, of whose parts those alone may give way that it then
        has."""
        of_lesion = ("suture_", "graft_", "adhesion_")
        kept = {n: w for n, w in (self.gives_way or {}).items() if not n.startswith(of_lesion)}
        return self.model_copy(update={"lesion": None, "gives_way": kept or None})

    def native_finger(self) -> NativeFinger:
        """The table of a finger of ours.  Raises InputError for one in an FMU."""
        try:
            return native(self.finger)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None
