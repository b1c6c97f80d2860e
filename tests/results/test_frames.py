"""A run's frames are the same of a fresh result and of one that was read."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from cosim.face import load, open_run, run
from cosim.hoods.view import arrays_of
from cosim.results.frames import _hood_of_state
from cosim.results.parts import Scene
from cosim.results.result import Result
from tests.helpers.motions import FREE, PLAIN

SMALL = ("hood.mesh.quads=120", "output.picture=false")
MOVING = (PLAIN, *FREE, 'forward={duration="0.004 s",must_rest=false}', "output.frames=2")
RUNS = {
    "at rest": ("isometric_edc", *SMALL),
    "net": ("cable_edc", 'hood.mesh.spacing="3 mm"', "output.picture=false"),
    "motion": ("isometric_edc_transversely_isotropic", *MOVING, SMALL[0]),
    "motion without a hood": ("pulley_edc", *MOVING),
}


@pytest.fixture(scope="module", params=RUNS)
def pair(request, tmp_path_factory) -> tuple[Result, Result]:
    name, *settings = RUNS[request.param]
    fresh = run(load(name, settings))
    return fresh, open_run(fresh.save(tmp_path_factory.mktemp("runs")))


def test_frames_of_a_fresh_run_are_those_of_the_one_read(pair):
    fresh, read = pair
    assert len(fresh.frames) == len(read.frames) > 1
    for one, other in zip(fresh.frames, read.frames, strict=True):
        assert (one.label, one.step, one.time) == (other.label, other.step, other.time)
        np.testing.assert_array_equal(one.angles, other.angles)
        np.testing.assert_array_equal(one.force, other.force)
        assert (one.hood is None) == (other.hood is None)
        if one.hood is not None and other.hood is not None:
            ours, its = arrays_of(one.hood), arrays_of(other.hood)
            assert ours.keys() == its.keys()
            for name, values in ours.items():
                np.testing.assert_array_equal(values, its[name], name)
            np.testing.assert_array_equal(one.hood.quads, other.hood.quads)


def same(one, other) -> None:
    """Whether two values, nested in tuples and mappings, are the same but for rounding."""
    if isinstance(one, dict | tuple | list):
        assert len(one) == len(other)
        pairs = ((one[k], other[k]) for k in one) if isinstance(one, dict) else zip(one, other)  # noqa: B905
        for a, b in pairs:
            same(a, b)
    elif isinstance(one, str):
        assert one == other
    else:
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_the_last_scene_of_a_run_that_was_read_is_what_the_fresh_one_draws(pair):
    fresh, read = pair
    for part in fields(Scene):
        if part.name not in ("hood", "frames"):
            drawn = getattr(fresh.scene, part.name)
            same(drawn, getattr(read.scenes[-1], part.name))
            same(drawn, getattr(read._whole_scene, part.name))


def test_a_hood_of_a_state_is_made_of_the_arrays_as_that_of_the_end_was():
    result = run(load("isometric_edc", SMALL))
    end = result.hood
    assert end is not None
    made = _hood_of_state(result.arrays, end, 1)
    assert made is not None
    for name, values in arrays_of(made).items():
        np.testing.assert_allclose(values, arrays_of(end)[name], rtol=1e-9, atol=1e-12)
