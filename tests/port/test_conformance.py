"""The promises of a hood, over the example of each kind of a coupled hood, and some beside them.

A factory gives (hood, motions to pass through, tension (nt,) N, tolerance of derivatives)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.hoods.kinds import KINDS
from cosim.models.build import build
from cosim.port import Array, Hood, Motion
from rigid.hoods.pulley import Cable, PulleyHood
from tests.helpers import conformance, networks

Subject = tuple[Hood, list[Motion], Array, float]
ON_BONES = {"EDC": 3.0, "EI": 1.0, "LUM": 0.8, "FPI": 0.5}
"""N; what shells and nets bear."""
IN_CLOSED_FORM = {"EDC": 10.0, "UI": 4.0, "LUM": 7.0}
"""N; with these no connecting tendon is about to go slack."""


def example(kind: str) -> Subject:
    """The hood of a kind's example, on that finger."""
    table = KINDS[kind].table
    name, *settings = table.example
    models = build(load_case(name, settings))
    finger = models.finger
    stated = ON_BONES if table.lies_on_bones else IN_CLOSED_FORM
    tension = np.array([stated.get(tendon, 2.0) for tendon in models.hood.tendons])
    motions = [
        finger.motion(finger.start({j: q for j, q in posture.items() if j in finger.joints}))
        for posture in conformance.POSTURES
    ]
    return models.hood, motions, tension, 1e-4 if table.lies_on_bones else 1e-6


def pulley_hood() -> Subject:
    motions = conformance.index_motions()
    central = Cable(
        (
            ("metacarpal", (-0.010, 0.001, 0.009)),
            ("proximal", (0.010, 0.0, 0.007)),
            ("proximal", (0.036, 0.0, 0.006)),
            ("middle", (0.004, 0.001, 0.004)),
        )
    )
    lateral = Cable(
        (
            ("metacarpal", (-0.008, 0.009, -0.006)),
            ("proximal", (0.030, 0.006, 0.002)),
            ("middle", (0.010, 0.003, 0.003)),
            ("distal", (0.003, 0.0, 0.002)),
        ),
        direction=(-1.0, 0.1, -0.2),
        compliance=2e-4,
    )
    hood = PulleyHood({"EDC": central, "LUM": lateral}, motions[0])
    return hood, motions, np.array([11.8, 2.5]), 1e-6


EXAMPLES = [name for name, kind in KINDS.items() if kind.table.is_coupled and kind.table.example]
HOODS: list[tuple[str, Callable[[], Subject]]] = [
    *((name, partial(example, name)) for name in EXAMPLES),
    ("compliant cables", pulley_hood),
    ("network of the index finger", networks.network_hood),
    ("network at a constant force", networks.constant_force_hood),
    ("two bands of the index finger", networks.two_band_hood),
]


def test_every_kind_of_ours_has_an_example() -> None:
    """A hood in an FMU is its program's, and checked where one is written; a split has no
    tendons."""
    assert set(KINDS) - set(EXAMPLES) == {"split", "fmu"}


@pytest.fixture(scope="module", params=[f for _, f in HOODS], ids=[name for name, _ in HOODS])
def subject(request: pytest.FixtureRequest) -> Subject:
    return request.param()


def test_shapes_and_names(subject: Subject) -> None:
    conformance.check_shapes(*subject[:3])


def test_wrong_input_is_refused(subject: Subject) -> None:
    hood, motions, tension, _ = subject
    conformance.check_errors(hood, motions[0], tension)


def test_a_repeated_step_gives_the_same_bits(subject: Subject) -> None:
    conformance.check_repeatable(*subject[:3])


def test_turning_the_hand_turns_the_load(subject: Subject) -> None:
    conformance.check_objective(*subject)


def test_force_and_moment_balance(subject: Subject) -> None:
    conformance.check_balance(*subject[:3])


def test_reciprocity(subject: Subject) -> None:
    conformance.check_reciprocity(*subject)


def test_jacobian(subject: Subject) -> None:
    conformance.check_jacobian(*subject)


def test_a_pulley_keeps_its_closed_form() -> None:
    """One cable over one hinge: arm = distance of the line from the axis, and x = c T at rest."""
    rest = Motion(("a", "b"), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    cable = Cable((("a", (-0.02, 0.0, 0.008)), ("b", (0.03, 0.0, 0.008))), compliance=1e-3)
    hood = PulleyHood({"T": cable}, rest)
    _, load, excursion = hood.advance(hood.start(rest), rest, np.array([5.0]), 0.1)
    assert load.total()[1] == pytest.approx([-5.0, 0, 0, 0, -0.04, 0])
    assert load.wrench[1, hood.sources.index("insertion")] == pytest.approx(load.total()[1])
    assert load.pull[0] == pytest.approx([-5.0, 0, 0, 0, -0.04, 0])
    assert load.total()[0] == pytest.approx(np.zeros(6))  # straight through the guide
    assert excursion == pytest.approx([5e-3])


def test_a_pulley_refuses_what_it_cannot_be() -> None:
    rest = Motion(("a", "b"), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    with pytest.raises(InputError, match="unknown body c"):
        PulleyHood({"T": Cable((("a", (0.0, 0.0, 0.0)), ("c", (1.0, 0.0, 0.0))))}, rest)
    with pytest.raises(InputError, match="points 0 and 1 coincide"):
        PulleyHood({"T": Cable((("a", (0.1, 0.0, 0.0)), ("b", (0.1, 0.0, 0.0))))}, rest)
    with pytest.raises(InputError, match="guide and an insertion"):
        Cable((("a", (0.0, 0.0, 0.0)),))
    hood = PulleyHood({"T": Cable((("a", (0.0, 0.0, 0.0)), ("b", (0.1, 0.0, 0.0))))}, rest)
    with pytest.raises(InputError, match="time step"):
        hood.advance(hood.start(rest), rest, np.ones(1), 0.0)
