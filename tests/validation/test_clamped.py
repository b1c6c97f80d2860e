"""Forces at a clamped fingertip on the board: by differences of arms, sizes, angles and shares."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.measured import read_measured, values_of
from cosim.validation.clamped import DIFFERENCES, FORCE, measured_differences, qiu_force
from cosim.validation.plan import groups, rows_of, split_answers
from cosim.validation.ratios import FLEXORS, INTRINSICS

BY_NAME = {g.name: g for g in groups()}
SYNEK = {
    "hood_minorflex_ri": (5.6, 0.7, 3.3, (3.7, 8.5, 4.7)),
    "hood_majorflex_ri": (7.3, -0.6, 1.2, (5.8, 11.1, 4.9)),
    "hood_minorflex_ui": (10.3, 1.3, -7.1, (5.4, 14.8, 10.5)),
    "hood_majorflex_ui": (11.6, 0.6, -4.9, (5.8, 17.5, 11.5)),
    "hood_minorflex_edc": (-6.0, -0.3, -0.3, (-5.9, -6.8, -5.4)),
    "hood_majorflex_edc": (-4.9, -1.6, 0.9, (-4.3, -5.7, -4.7)),
    "middle_minorflex_fdp": (2.8, 6.8, -3.5, (3.2, 1.6, 3.5)),
    "middle_majorflex_fdp": (3.4, 6.4, -4.0, (4.1, 2.7, 3.3)),
    "middle_minorflex_fds": (7.4, 6.8, -3.1, (7.7, 7.4, 7.1)),
    "middle_majorflex_fds": (8.0, 6.1, -3.1, (9.3, 7.0, 7.5)),
}
"""mm, worked out apart from this program: MCP less PIP, PIP less DIP, abduction; the first of each
hand."""


def test_what_is_kept_blind_is_in_no_table():
    postures = {r.posture for r in read_measured("qiu2017")}
    assert not [p for p in postures if p.startswith("60/")]
    assert {r.hand for r in read_measured("cohn2017")} == {"A", "3"}


@pytest.mark.parametrize(
    ("muscle", "posture", "force"),
    [
        ("EDC", "0/30/0", (3.1, 10.8)),
        ("EDC", "30/45/15", (4.9, 11.4)),
        ("FDP", "0/60/30", (-20.4, -1.4)),
        ("FDP", "30/60/30", (-21.5, 8.6)),
    ],
)
def test_arms_make_the_force_that_was_worked_out_from_them(muscle, posture, force):
    """To what a digit more of each arm would change."""
    made = qiu_force(posture, measured_differences(muscle, posture))
    np.testing.assert_allclose(made, force, atol=0.35)


def test_the_printed_forces_agree_with_the_digitised_arms():
    """Two readings of one experiment: within 2 % of the tension."""
    for m in read_measured("qiu2017"):
        muscle = m.muscle
        if m.axis == "distal":
            bend = np.radians(sum(map(float, m.posture.split("/"))))
            x, z = qiu_force(m.posture, measured_differences(muscle, m.posture))
            dorsal = values_of("qiu2017", m.posture)[f"force_over_tension.{muscle}.dorsal"]
            distal = np.cos(bend) * x - np.sin(bend) * z
            assert abs(distal - m.number()) < 2, (muscle, m.posture)
            assert abs(np.sin(bend) * x + np.cos(bend) * z - dorsal) < 2, (muscle, m.posture)


def test_the_arms_of_three_hands_are_those_worked_out_by_hand():
    shown = {}
    for name in ("cadaver arms: hood", "cadaver arms: flexors"):
        group = BY_NAME[name]
        for trial in group.trials:
            means = [t.reference for t in group.targets if t.case == trial.name]
            hands = [
                next(t.reference for t in each if t.case == trial.name)
                for each in group.hands.values()
            ]
            shown[trial.name] = (*means, *hands)
    for trial, (*means, hands) in SYNEK.items():
        np.testing.assert_allclose(shown[trial], (*means, *hands), atol=0.11, err_msg=trial)


def test_force_and_differences_of_one_source_are_not_both_judged():
    judged = [t for g in BY_NAME.values() if not g.variant for t in g.targets]
    by_arms = {t.source for t in judged if t.quantity in DIFFERENCES.values()}
    by_force = {t.source for t in judged if t.quantity.startswith(FORCE)}
    assert by_arms
    assert by_force
    assert not by_arms & by_force


def said(force: tuple[float, float, float], tension: float) -> dict:
    axes = dict(zip(("distal", "radial", "dorsal"), force, strict=True))
    return {
        "difference": {"fingertip_force_N": axes},
        "tension_N": {"A": tension, "B": 0.05},
        "unloaded": {"tension_N": {"A": 0.05, "B": 0.05}},
    }


def test_sizes_are_over_the_rise_of_tension_and_the_split_answers_in_kind():
    group = BY_NAME["Cohn 2017: hood"]
    summaries = {
        "cohn hood EDC 45/45/10": said((0.3, 0.0, 0.4), 2.05),
        "cohn split EDC 45/45/10": said((0.0, 0.0, 1.0), 2.05),
    }
    rows = list(rows_of(group, summaries))
    (edc,) = [r for r in rows if r.model is not None]
    assert (edc.model, edc.target.reference) == (pytest.approx(0.25), 0.107)
    (answer,) = split_answers(group, rows, summaries).values()
    assert answer == pytest.approx(0.5)


def test_angles_are_between_forces_and_edcs():
    group = BY_NAME["Cohn 2017: angles to EDC"]
    summaries = {
        "cohn hood EDC 45/45/10": said((1.0, 0.0, 0.0), 1.0),
        "cohn hood FPI 45/45/10": said((0.0, -2.0, 0.0), 1.0),
        "cohn split FDI 45/45/10": said((-3.0, 0.0, 0.0), 1.0),
    }
    found = {r.target.name[:3]: r.model for r in rows_of(group, summaries)}
    assert found == {
        "EI ": None,
        "LUM": None,
        "FPI": pytest.approx(90),
        "FDI": pytest.approx(180),
        "FDP": None,
        "FDS": None,
    }


def test_shares_of_the_moment_are_by_arms_and_strengths():
    group = BY_NAME["Buford 2005: shares of the MCP's moment"]
    arms = {m: {"MCP": 10.0 if m in FLEXORS else 0.0} for m in (*INTRINSICS, *FLEXORS)}
    arms["LUM"] = {"MCP": 5.0}
    summary = {"unloaded": {"moment_arm_mm": arms}}
    rows = list(rows_of(group, {"force ti EDC": summary}))
    lumbrical = 100 * 25.04 * 5 / (25.04 * 5 + (79.12 + 58.9) * 10)
    assert [r.model for r in rows] == pytest.approx([lumbrical, lumbrical])
    assert [r.target.reference for r in rows] == [24, 2]


def test_the_metacarpal_and_the_fingertip_share_the_pull():
    """The tip bears what the tendons pull with and the metacarpal does not bear."""
    group = BY_NAME["metacarpal loads"]
    (proximal,) = [
        t for t in group.targets if "7.782" in t.name and t.quantity.endswith("proximal")
    ]
    assert proximal.reference == pytest.approx(2 * 7.782 - 11.57)
    assert [t.name for t in group.trials] == [
        "metacarpal 40/55/35 2.457 N",
        "metacarpal 40/55/35 7.782 N",
        "metacarpal 55/57/25 2.457 N",
    ]
