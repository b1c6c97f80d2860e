"""What a surgeon would see, by rules from made-up numbers."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cosim.report.clinical_signs import clinical_signs, sign_sentences

STRAIGHT = (-2.0, 0.0, -4.0)


def finger(mcp, pip, dip, *, terminal=5.0, bands=(3.0, 2.0), shift=0.0, cut=()):
    summary = {
        "posture_deg": {"MCP": mcp, "MCP_abduction": 4.0, "PIP": pip, "DIP": dip},
        "slip_force_N": {"central": 3.0, "terminal": terminal},
        "lateral_band_height_mm": dict(zip(("radial", "ulnar"), bands, strict=True)),
        "tendon_shift_mm": shift,
    }
    return SimpleNamespace(summary=summary, case_table={"lesion": {"cut": list(cut)}})


def said(after, before=None) -> str:
    return " ".join(sign_sentences(clinical_signs(before or finger(*STRAIGHT), after)))


CASES = {
    "a mallet finger": finger(-2, 0, 31, cut=["terminal_slip"]),
    "a swan neck": finger(-2, -18, 31, cut=["terminal_slip"]),
    "a loss of extension": finger(-2, 9, -7, cut=["central_slip"]),
    "a boutonniere deformity": finger(-2, 85, -4, bands=(-3.0, -4.0), cut=["central_slip"]),
    "slips 6.2 mm to the ulnar side": finger(-2, 0, -4, shift=-6.2, cut=["sagittal_band_radial"]),
    "stays over the MCP": finger(-2, 0, -4, shift=-0.1, cut=["sagittal_band_ulnar"]),
    "The MCP loses 3 deg of extension": finger(1, 4, -4, cut=["extensor_tendon_distal"]),
    "a surgeon would see nothing": finger(0, 2, -1, cut=["lateral_band_ulnar"]),
}


@pytest.mark.parametrize("words", CASES)
def test_each_deformity_has_its_words_and_no_other_s(words):
    text = said(CASES[words])
    assert "The intact finger is straight, at MCP -2, PIP 0, DIP -4 deg." in text
    assert words in text
    seen = " ".join(s.seen for s in clinical_signs(finger(*STRAIGHT), CASES[words]))
    others = [w for w in CASES if w != words and w in seen]
    assert others == (["a mallet finger"] if words == "a swan neck" else [])


def test_what_is_printed_stands_with_its_own_lesion_alone():
    assert "clinic 30 to 50" in said(CASES["a mallet finger"])
    drooping = finger(-2, 0, 31, cut=["lateral_band_ulnar"])
    assert "droops by 35 deg." in said(drooping)
    assert "clinic" not in said(drooping)


@pytest.mark.parametrize(("terminal", "dip", "word"), [(9.0, -9, "positive"), (2.0, 3, "negative")])
def test_elson_s_test_is_of_the_stiffness_of_the_dip(terminal, dip, word):
    held = finger(0, 90, 3, terminal=1.8)
    text = said(finger(0, 90, dip, terminal=terminal, cut=["central_slip"]), held)
    assert f"Elson's test is {word}" in text
    assert "lags" not in text


def test_an_adhesion_costs_flexion():
    text = said(finger(67, 17, 9), finger(67, 76, 42))
    assert "The intact finger stands at MCP 67, PIP 76, DIP 42 deg." in text
    assert "The PIP loses 59 deg of flexion." in text
    assert "The DIP loses 33 deg of flexion." in text
