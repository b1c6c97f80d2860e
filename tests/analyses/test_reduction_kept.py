"""Samples of a reduction kept in a file."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.analyses.reduction.samples import (
    FailedSample,
    Walk,
    WalkSamples,
    kept_samples,
    on_models,
)
from cosim.cli import app
from cosim.errors import InputError
from cosim.hoods.lumped.build import Sample
from tests.helpers.soft_network import soft_models

ANGLE = np.array([[0, 0, 0.3, 0.1], [0, 0, 0.35, 0.1]])
WALKS = [Walk(ANGLE + 0.05 * k, np.full((2, 3), 8.0)) for k in range(3)]


class CutOff(Exception):
    pass


def sampler(asked: list[Walk], most: int = 99):
    """Samples a network and says which walks it was asked for; cut off after `most` of them."""
    models = soft_models()

    def sample(walks):
        for k, walk in enumerate(walks):
            if k == most:
                raise CutOff
            asked.append(walk)
            states = list(on_models(models, walk))
            yield WalkSamples(
                [*states, FailedSample(walk.angles[0], walk.tensions[0], "stuck")], 0.25
            )

    return sample


def same(one: Sample | FailedSample, other: Sample | FailedSample) -> bool:
    return type(one) is type(other) and all(
        np.array_equal(value, getattr(other, name)) for name, value in vars(one).items()
    )


def test_what_was_cut_off_goes_on_with_the_same_bits(tmp_path):
    path, asked = tmp_path / "samples.json", []
    with pytest.raises(CutOff):
        list(kept_samples(path, "a case", WALKS, sampler(asked, 2)))
    assert asked == WALKS[:2]
    found = list(kept_samples(path, "a case", WALKS, sampler(asked)))
    assert asked == WALKS
    again = list(kept_samples(path, "a case", WALKS[::-1], sampler(asked)))[::-1]
    assert asked == WALKS  # no more
    fresh = list(sampler([])(WALKS))
    for told in (found, again):
        for walk, expected in zip(told, fresh, strict=True):
            assert walk.seconds == expected.seconds
            assert all(map(same, walk.states, expected.states))


def test_samples_of_another_case_are_refused(tmp_path):
    path = tmp_path / "samples.json"
    list(kept_samples(path, "a case", WALKS[:1], sampler([])))
    before = path.read_bytes()
    with pytest.raises(InputError, match="holds samples of another case"):
        list(kept_samples(path, "another", WALKS, sampler([])))
    assert path.read_bytes() == before


def damage(told: dict, name: str, value: object) -> str:
    (walk,) = told["walks"].values()
    walk["found"][0][name] = value
    return json.dumps(told)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("torque", [1.0, 2.0], r"torque has the shape \(2,\), not \(4,\)"),
        ("arms", "many", "could not convert"),
        ("excursion", [0.0, float("nan"), 0.0], "excursion is not finite"),
        ("tension", None, "tension has the shape"),
    ],
)
def test_a_damaged_file_is_told(tmp_path, name, value, reason):
    path = tmp_path / "samples.json"
    list(kept_samples(path, "a case", WALKS[:1], sampler([])))
    path.write_text(damage(json.loads(path.read_text()), name, value))
    with pytest.raises(InputError, match=f"damaged .*{reason}"):
        list(kept_samples(path, "a case", WALKS[:1], sampler([])))


@pytest.mark.parametrize(
    "text", ["", "[1]", "{}", '{"case": 1, "walks": 3}', "[" * 100_000, "\xff"]
)
def test_a_file_of_another_kind_ends_in_one_message(tmp_path, text):
    path = tmp_path / "samples.json"
    path.write_text(text, encoding="latin-1")
    words = ["export", "fingertip_isotropic_edc", "-o", str(tmp_path / "r.toml")]
    done = CliRunner().invoke(app, [*words, "--samples", str(path), "--workers", "1"])
    assert done.exit_code == 2, done.output
    assert "is no file of samples" in " ".join(done.output.split())
    assert path.read_text(encoding="latin-1") == text
