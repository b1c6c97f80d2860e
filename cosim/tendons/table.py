"""What a case may say of tendons: tension or activation, its signal, the muscle."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from cosim.port import Array
from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import File, Force, Number, Table
from cosim.tendons.drive_tables import ElasticConfig, MotorConfig, PneumaticConfig

Factor = Annotated[Number, Field(ge=0, le=1e6)]


class PointsSignalConfig(Table):
    """Factors at times, straight between them and constant beyond."""

    kind: Literal["points"]
    at: Annotated[
        tuple[
            tuple[Annotated[float, quantity(units.TIME, least="0 s", most="1e6 s")], Factor], ...
        ],
        Field(min_length=1),
    ]
    """Pairs of time and factor."""

    @model_validator(mode="after")
    def _rising(self) -> PointsSignalConfig:
        if any(b <= a for (a, _), (b, _) in pairwise(self.at)):
            raise fault("at: its times must rise from point to point")
        return self


class SineSignalConfig(Table):
    """mean + amplitude sin(2 pi frequency t + phase), never below zero."""

    kind: Literal["sine"]
    frequency: Annotated[float, quantity(units.FREQUENCY, above="0 Hz", most="1000 Hz")]
    """Oscillations per second."""
    mean: Factor
    """Mean factor."""
    amplitude: Factor
    """Amplitude of the factor."""
    phase: Annotated[float, quantity(units.ANGLE, least="-360 deg", most="360 deg")] = 0.0
    """Phase at time zero."""


class FileSignalConfig(Table):
    """Factors from a column of a table over time: .sto or .mot, or .csv with a column `time`."""

    kind: Literal["file"]
    path: File
    """The table, .sto, .mot or .csv."""
    column: str
    """Name of the column of factors."""


SignalConfig = Annotated[
    PointsSignalConfig | SineSignalConfig | FileSignalConfig, Field(discriminator="kind")
]


class MillardConfig(Table):
    """The equilibrium muscle of Millard et al. 2013 between its tendon's path and the bone.

    `fibre_length`: of the fibre over its optimal length, in the case's posture at the case's
    activation; nobody measured it, and the force depends on it.  An activation below 0.01 acts as
    0.01, as in OpenSim."""

    kind: Literal["millard"]
    optimal_fibre_length: Annotated[float, quantity(units.LENGTH, above="0 mm", most="500 mm")]
    """Fibre length of the greatest active force."""
    tendon_slack_length: Annotated[float, quantity(units.LENGTH, above="0 mm", most="1000 mm")]
    """Length of the unloaded tendon."""
    pennation: Annotated[float, quantity(units.ANGLE, least="0 deg", most="60 deg")] = 0.0
    """Angle of fibre and tendon at the optimal length."""
    fibre_length: Annotated[Number, Field(ge=0.4, le=1.7)] = 1.0
    """Fibre length over the optimal one, in the unloaded posture: an assumption."""
    tendon: Literal["elastic", "rigid"] = "elastic"
    """Whether the tendon stretches."""


Sliding = Literal["loading", "unloading", "frictionless"]


class TendonConfig(Table):
    """A muscle: its tension, or its greatest force and its activation (0..1); with neither it is
    at the resting tension.  The force of an activation is activation times the greatest force, or
    what `muscle` makes of it."""

    tension: Force | None = None
    """Tension, in place of an activation."""
    max_force: Force | None = None
    """Greatest isometric force, which `activation` is a part of."""
    activation: Annotated[Number, Field(ge=0, le=1)] | None = None
    """Activation, 0 to 1."""
    muscle: MillardConfig | None = None
    """A muscle with a fibre; without it the tension is activation times greatest force."""
    excursion: Annotated[float, quantity(units.LENGTH, least="-50 mm", most="50 mm")] | None = None
    """In place of a tension: how far the tendon's end is drawn proximally from the unloaded state,
    or in a motion from its start; the tension that this takes is found."""
    actuation: Annotated[PneumaticConfig | MotorConfig, Field(discriminator="kind")] | None = None
    """In place of a tension, in a motion: what pulls, and on what command."""
    elastic: ElasticConfig | None = None
    """A tendon that stretches, where its end is drawn or a motor pulls it, or where friction acts
    as it stretches; without it the tendon keeps its length."""
    signal: SignalConfig | None = None
    """Over time, of a motion: what tension, activation, excursion or command is multiplied by."""

    friction: Annotated[Number, Field(ge=0, le=2)] | None = None
    """Coulomb's coefficient along a tendon of the finger's own, where it wraps a surface or turns
    at a guide point; without it the tendon glides freely."""
    sliding: Sliding | None = None
    """Which way a tendon with friction slides at its guides: "loading" (by default; towards the
    muscle, so that tension falls on the way to the insertion), "unloading", or "frictionless"; of a
    motion at its start, after which friction follows the slide."""
    presliding: Annotated[float, quantity(units.LENGTH, least="0.001 mm", most="10 mm")] | None = (
        None
    )
    """Slide over which friction in a motion turns from none to all; by default 0.1 mm, an
    assumption."""

    @model_validator(mode="after")
    def _rubs(self) -> TendonConfig:
        for key in ("sliding", "presliding"):
            if self.friction is None and getattr(self, key) is not None:
                raise fault(f"gives {key} without friction; add for example friction = 0.04")
        return self

    @model_validator(mode="after")
    def _one_way(self) -> TendonConfig:
        if self.tension is not None and self.activation is not None:
            raise fault("gives both tension and activation; write one of them")
        if self.excursion is not None and (self.tension, self.activation) != (None, None):
            raise fault("gives an excursion and a tension or activation; write one of them")
        if self.actuation is not None:
            others = {"tension", "activation", "muscle", "excursion"} & self.model_fields_set
            if others := {name for name in others if getattr(self, name) is not None}:
                raise fault(f"gives actuation and {min(others)}; write one of them")
        motor = self.actuation is not None and self.actuation.kind == "motor"
        if motor and self.elastic is None:
            raise fault(
                'gives a motor without elastic; add for example elastic = { stiffness = "50 N/mm" }'
            )
        if self.elastic is not None and not motor:
            if self.excursion is None and self.friction is None:
                raise fault(
                    "gives elastic where a tension is stated, which no stretch changes; state an "
                    "excursion or a motor, or leave it out"
                )
            if self.actuation is not None:
                raise fault("gives elastic and a pneumatic cylinder; leave one of them out")
        if self.tension is not None and self.muscle is not None:
            raise fault("gives both tension and muscle; a muscle's tension follows from activation")
        if self.activation is not None and self.max_force is None:
            raise fault('gives activation without max_force; add for example max_force = "35 N"')
        return self

    @property
    def force(self) -> float | None:
        """The stated tension (N); None: at the resting tension."""
        if self.activation is not None and self.max_force is not None:
            return self.activation * self.max_force
        return self.tension


def stretch_of(tendons: Sequence[TendonConfig]) -> tuple[Array, Array]:
    """By how much tendons stretch (n,) m/N, and their slack (n,) m; zero of one that keeps its
    length."""
    elastic = [t.elastic for t in tendons]
    give = [0.0 if e is None else 1.0 / e.rate for e in elastic]
    return np.array(give), np.array([0.0 if e is None else e.slack for e in elastic])
