"""Numbers that are not finite, or that nothing has, in models of other programs: refused with their
file and line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.models.build import mjcf_of
from rigid.mjcf.read import read_mjcf
from rigid.opensim.osim import import_osim
from tests.helpers.folders import ROOT

WORDS = ("nan", "inf", "-inf", "1e300")
OF_MJCF = ("pos", "quat", "axis", "range", "size", "mass", "fromto", "diaginertia")
OF_MUSCLES = ("max_isometric_force", "tendon_slack_length", "optimal_fiber_length")


def with_words(text: str, pattern: str, count: int) -> Iterator[tuple[str, int]]:
    """The text with one number of what the pattern finds turned into each of WORDS, in so many
    places; and the line."""
    rng = np.random.default_rng(63)
    found = list(re.finditer(pattern, text))
    for i in rng.permutation(len(found))[:count]:
        numbers = found[i][1].split()
        for word in WORDS:
            numbers[rng.integers(len(numbers))] = word
            start, end = found[i].span(1)
            yield text[:start] + " ".join(numbers) + text[end:], text.count("\n", 0, start) + 1


@pytest.mark.parametrize("key", OF_MJCF)
def test_numbers_of_mjcf_that_are_not_finite_are_refused(key: str, tmp_path: Path) -> None:
    path, text = tmp_path / "finger.xml", mjcf_of(load_case("split_edc"))
    for changed, line in with_words(text, rf'\b{key}="([^"]*)"', 3):
        path.write_text(changed)
        with pytest.raises(InputError, match=rf"finger\.xml, line {line}, <\w+>: {key} has"):
            read_mjcf(path)


def test_numbers_of_an_included_file_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    text = mjcf_of(load_case("split_edc"))
    start, end = text.index("<worldbody>"), text.index("</worldbody>") + len("</worldbody>")
    spoilt = re.sub(r'\bpos="\S+', 'pos="nan', text[start:end], count=1)
    (tmp_path / "bodies.xml").write_text(f"<mujoco>{spoilt}</mujoco>")
    path = tmp_path / "finger.xml"
    path.write_text(f'{text[:start]}<include file="bodies.xml"/>{text[end:]}')
    with pytest.raises(InputError, match="a file that it includes states"):
        read_mjcf(path)


@pytest.mark.parametrize("word", ["&#105;nf", "&#x6e;an", "1&#101;300", "-&#x69;nf"])
@pytest.mark.parametrize("key", OF_MJCF[:3])
def test_a_number_by_character_references_is_the_same_number(
    word: str, key: str, tmp_path: Path
) -> None:
    path, text = tmp_path / "finger.xml", mjcf_of(load_case("split_edc"))
    path.write_text(re.sub(rf'\b{key}="\S+', f'{key}="{word}', text, count=1))
    with pytest.raises(InputError, match=rf"finger\.xml, line \d+, <\w+>: {key} has"):
        read_mjcf(path)


def test_what_a_comment_says_is_no_number(tmp_path: Path) -> None:
    path, text = tmp_path / "finger.xml", mjcf_of(load_case("split_edc"))
    path.write_text(text.replace("<worldbody>", '<!-- pos="inf 0 0" -->\n<worldbody>', 1))
    assert read_mjcf(path).model.joints


@pytest.mark.parametrize("key", OF_MUSCLES)
def test_numbers_of_muscles_that_are_not_finite_are_refused(key: str, tmp_path: Path) -> None:
    path = tmp_path / "model.osim"
    text = (ROOT / "cases" / "data" / "finger.osim").read_text()
    assert f"<{key}>" in text
    for changed, line in with_words(text, rf"<{key}>([^<]*)</{key}>", 1):
        path.write_text(changed)
        with pytest.raises(InputError, match=rf"model\.osim, line {line}, .*{key}: expected"):
            import_osim(path)
