"""A tendon network whose springs all bear, so that it is a polynomial, and its states."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from cosim.analyses.reduction.samples import FREE, Walk, on_models
from cosim.case.file import load_case
from cosim.hoods.lumped.build import slip_forces
from cosim.hoods.lumped.table import NetworkHoodConfig
from cosim.models.build import Models, build
from cosim.port import STATIC
from rigid.hoods.reduced import ReducedPotential
from rigid.hoods.reduction import Order, Sample, reduce_hood, stack
from tests.proofs.hoods.reduction_rows import SOFT

JOINTS, MUSCLES = ("MCP", "MCP_abduction", "PIP", "DIP"), ("EDC", "LUM", "FPI")
STRAIGHT = Order(angle=4, toe=None)
FITTED = 140


def soft_models() -> Models:
    return build(load_case("network_edc", [*SOFT, FREE]))


def walk(count: int, seed: int) -> Walk:
    rng = np.random.default_rng(seed)
    angle = rng.uniform([-0.1, 0.0, 0.1, 0.0], [0.6, 0.0, 0.9, 0.4], (count, 4))
    return Walk(angle, rng.uniform(7.0, 12.0, (6, 3)))


@lru_cache(maxsize=1)
def samples() -> tuple[Sample, ...]:
    """Samples of the soft network, with the slips that its springs make."""
    case, models = load_case("network_edc", SOFT), soft_models()
    assert isinstance(case.hood, NetworkHoodConfig)
    out = []
    for s in on_models(models, walk(28, 0)):
        assert isinstance(s, Sample)
        at = models.finger.start(dict(zip(models.finger.joints, s.angle, strict=True)))
        motion = models.finger.motion(at)
        state = models.hood.advance(models.hood.start(motion), motion, s.tension, STATIC).state
        slips = slip_forces(case.hood, state)
        assert sum(slips.values()) == pytest.approx(s.tension.sum(), rel=1e-12)
        out.append(replace(s, slip=np.array([slips["central"], slips["terminal"]])))
    return tuple(out)


def training_sample() -> Sample:
    return stack(samples()[:FITTED])


def unseen_sample() -> Sample:
    return stack(samples()[FITTED:])


@lru_cache(maxsize=1)
def reduced_potential() -> ReducedPotential:
    return reduce_hood(training_sample(), JOINTS, MUSCLES, STRAIGHT)
