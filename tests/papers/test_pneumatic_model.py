"""The paper's polynomial model: identification, shares explained, latency, anticipation."""

from __future__ import annotations

import numpy as np
import pytest

from cases.papers.models.xu2012.air_model import (
    AT,
    FULL_TERMS,
    PRINTED_TERMS,
    SAMPLE,
    UNSEEN,
    AirModel,
    Identification,
    PressureRecord,
    identification,
    identify,
    latency,
    r_squared,
    simulate_record,
    sines,
    spread,
    steps,
)
from cosim.errors import InputError
from cosim.port import Array
from cosim.report.gallery import open_paper
from rigid.air.plant import Pneumatics, Valve

TRUE = np.array([2e5, -5e4, 9e3, -2.0, 1.0, -0.3, 0.02])
LAG = 2


def exact_record(model: AirModel, count: int = 120, n: int = 6) -> PressureRecord:
    """A record whose central differences are the model's rates exactly."""
    rng = np.random.default_rng(3)
    time = SAMPLE * np.arange(1.0, count + 1.0)
    swing = np.sin(2 * np.pi * rng.uniform(1, 6, n) * time[:, None] + rng.uniform(0, 6, n))
    voltage = 5.0 + rng.uniform(0.5, 2.0, n) * swing + rng.normal(0.0, 0.3, (count, n))
    pressure = rng.uniform(1e5, 4e5, (count, n))
    for k in range(1, count - 1):
        before = voltage[max(k - model.lag, 0)]
        pressure[k + 1] = pressure[k - 1] + 2 * SAMPLE * model.rate(pressure[k], before)
    return PressureRecord(time, voltage, pressure)


MODEL = AirModel(PRINTED_TERMS, TRUE, np.zeros(7), LAG)


def test_identification_finds_what_a_record_was_made_with() -> None:
    found = identify(exact_record(MODEL))
    assert found.lag == LAG
    assert found.coefficients == pytest.approx(TRUE, rel=1e-6)
    assert (found.interval < 1e-6 * np.abs(TRUE)).all()
    assert r_squared(found, exact_record(MODEL))[0] == pytest.approx(1.0)
    full = identify(exact_record(MODEL), LAG, FULL_TERMS)
    assert full.coefficients[[0, 2, 3, 4, 5, 6, 7]] == pytest.approx(TRUE, rel=1e-4)
    assert abs(full.coefficients[1]) < 1.0


def test_what_a_model_explains_is_counted_against_the_mean() -> None:
    record = exact_record(MODEL)
    rate = record.rate[LAG - 1 :]
    mean = AirModel(((0, 0),), np.array([rate.mean()]), np.zeros(1), LAG)
    assert r_squared(mean, record)[0] == pytest.approx(0.0, abs=1e-12)
    whole, each = r_squared(identify(record, LAG, ((0, 0), (0, 1))), record)
    assert 0.0 < whole < 0.95
    assert each.shape == (6,)


def test_intervals_of_white_noise_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    x, noise = rng.normal(size=(20000, 4, 2)), 0.3 * rng.normal(size=(20000, 4))
    assert spread(x, noise) == pytest.approx([0.3 / np.sqrt(80000.0)] * 2, rel=0.1)
    alike = np.repeat(noise[:400], 50, axis=0)  # one error for fifty samples of a constant
    ones = np.ones((20000, 4, 1))
    assert spread(ones, alike) == pytest.approx([0.3 / np.sqrt(1600.0)], rel=0.1)


def test_a_record_that_cannot_tell_them_apart_is_refused() -> None:
    still = PressureRecord(SAMPLE * np.arange(1.0, 50.0), np.full((49, 1), 5.0), np.ones((49, 1)))
    with pytest.raises(InputError, match="tells only 1 of 7 coefficients apart"):
        identify(still)
    with pytest.raises(InputError, match="less than three values"):
        simulate_record(Pneumatics(), lambda t: np.full(1, 5.0), 0.02, 1)
    with pytest.raises(InputError, match="amplitude"):
        sines(Pneumatics(), (1.0,), 6.0)


def test_anticipation_solves_the_equation_exactly() -> None:
    p, v = np.array([1e5, 5e5]), np.array([[4.8, 5.3]])
    whole, halves = MODEL.ahead(p, v), MODEL.ahead(p, np.repeat(v, 2, axis=0), SAMPLE / 2)
    assert halves == pytest.approx(whole, rel=1e-12)
    slope = (MODEL.ahead(p, v, 1e-7) - p) / 1e-7
    assert slope == pytest.approx(MODEL.rate(p, v[0]), rel=1e-3)
    flat = AirModel(((0, 0),), np.array([3.0]), np.zeros(1), 0)
    assert flat.ahead(p, v, 2.0) == pytest.approx(p + 6.0)


def test_anticipation_is_nearer_the_plant_than_standing_still() -> None:
    """Over the delay, from voltages that are given and not yet felt."""
    found = identification(Pneumatics(), duration=2.0)
    record, lag = found.unseen, found.model.lag
    rows = np.arange(lag, len(record.time) - lag)
    told = np.stack([record.voltage[rows - lag + j] for j in range(lag)])
    ahead = found.model.ahead(record.pressure[rows], told)
    later = record.pressure[rows + lag]
    miss, still = ahead - later, record.pressure[rows] - later
    assert np.sqrt((miss**2).mean()) < 0.35 * np.sqrt((still**2).mean())


def test_the_plant_is_explained_on_frequencies_not_seen() -> None:
    found = identification(Pneumatics(), duration=4.0)
    assert found.model.lag == 3
    assert r_squared(found.model, found.unseen)[0] > 0.95
    assert r_squared(identify(found.training, 0), found.unseen)[0] < 0.8
    check_figure_6(found)


def check_figure_6(found: Identification) -> None:
    """Figure 6's curves belong together: its table gives the R2 again."""
    (figure,) = open_paper("xu2012", {"air_identification": lambda plant: found}).run("air")
    frame = figure.tables["figure_6_coefficients"]
    assert list(frame.coefficient) == ["a0", "a2", "a3", "b0", "b1", "b2", "b3"]
    assert (frame.half_of_95_percent_interval > 0).all()
    table = figure.tables["figure_6_flow_rate"]
    course = table[table.frequency_Hz == UNSEEN[3]]
    plant, model = course.plant_dPdt_kPa_per_s, course.model_dPdt_kPa_per_s
    share = 1 - ((plant - model) ** 2).sum() / ((plant - plant.mean()) ** 2).sum()
    assert share == pytest.approx(r_squared(found.model, found.unseen)[1][3])
    k = int(np.argmin(np.abs(found.unseen.time - course.time_s.iloc[40])))
    assert plant.iloc[40] == pytest.approx(1e-3 * found.unseen.rate[k - 1, 3])


def test_nothing_happens_before_the_delay_and_most_some_20_ms_after() -> None:
    for delay in (0.0, 0.03):
        record = steps(Pneumatics(Valve(delay=delay)), 0.0, (5.2, 6.0), 0.2)
        before = record.pressure[record.time <= AT + delay + 1e-9]
        assert np.abs(before).max() < 1e-6
        assert record.pressure[record.time > AT + delay + 0.5 * SAMPLE].min() > 0.0
        found: Array = latency(record)
        assert (delay + 0.01 <= found).all()
        assert (found <= delay + 0.0301).all()


def test_each_cylinder_has_a_delay_of_its_own() -> None:
    both = steps(Pneumatics(Valve(delay=np.array([0.0, 0.03]))), 0.0, (6.0, 6.0), 0.2)
    for k, delay in enumerate((0.0, 0.03)):
        one = steps(Pneumatics(Valve(delay=delay)), 0.0, (6.0,), 0.2)
        assert both.pressure[:, k] == pytest.approx(one.pressure[:, 0], rel=2e-4, abs=1e-3)
