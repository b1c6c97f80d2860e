"""What a study's numbers say: bands, indices of variance, slopes, a response surface.

Pure functions of arrays: rows are runs, columns parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import ceil, log
from typing import NamedTuple

import numpy as np

from cosim.extras import require
from cosim.port import Array
from cosim.study.sampling import LEVELS, block, problem

QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
CONFIDENCE = 0.95
NORMAL = 1.959964
"""SDs of a normal distribution's interval of that confidence."""
RESAMPLES = 200
"""Resamples of the bootstrap that gives the indices' confidence."""
MOST_LOST = 0.1
"""The part of Saltelli's blocks that may have a failed run. Where more have one there are no
indices: what fails is hardly a sample of what there is."""
LEAST_BLOCKS = 8
WIDE = 0.1
"""Half width of an interval of an index, or of a slope in SDs, beyond which the runs are too few to
say more than the order of the strongest."""
FOLDS = 10
SEED = 1
"""Seed of the bootstrap and the folds; not 0, which SALib takes for none."""


class Band(NamedTuple):
    """The distribution of an output over the runs that converged; `quantiles` at `QUANTILES`."""

    runs: int
    mean: float
    sd: float
    quantiles: tuple[float, ...]


def band(values: Array) -> Band | None:
    """The band of (n,) values, those that are not finite left out; None below two."""
    kept = values[np.isfinite(values)]
    if len(kept) < 2:
        return None
    at = tuple(float(q) for q in np.quantile(kept, QUANTILES))
    return Band(len(kept), float(kept.mean()), float(kept.std(ddof=1)), at)


@dataclass(frozen=True)
class Indices:
    """Sobol's indices, a number for each parameter, with half the width of their 95 % intervals;
    `blocks` of `planned` blocks had no failed run and are in them.  `second` (d, d) above the
    diagonal, where it was sampled."""

    first: Array
    first_conf: Array
    total: Array
    total_conf: Array
    second: Array | None
    blocks: int
    planned: int


def indices(values: Array, dimensions: int, second_order: bool) -> Indices | str:
    """Sobol's indices of an output (m,) at Saltelli's points in their order, NaN where a run
    failed: a block with such a run is left out whole. Estimators: Saltelli et al. 2010 (Comput Phys
    Commun 181:259) and Jansen's, as in SALib. A text says why there are none."""
    size = block(dimensions, second_order)
    blocks = values.reshape(-1, size)
    kept = blocks[np.isfinite(blocks).all(axis=1)]
    lost = len(blocks) - len(kept)
    if lost > MOST_LOST * len(blocks):
        return (
            f"no indices: {lost} of {len(blocks)} blocks of the sample hold a run without a value, "
            f"more than {MOST_LOST:.0%}"
        )
    if len(kept) < LEAST_BLOCKS:
        return f"no indices: {len(kept)} blocks are too few; at least {LEAST_BLOCKS}"
    if np.ptp(kept) == 0:
        return "no indices: the output is the same in every run"
    return _indices(kept, len(blocks), dimensions, second_order)


@dataclass(frozen=True)
class Screening:
    """Morris' measures of the elementary effects, a number for each parameter in the output's unit,
    with half the width of their 95 % intervals; `trajectories` of `planned` had no failed run."""

    mu: Array
    """Mean effect."""
    mu_star: Array
    """Mean size of the effects."""
    mu_star_conf: Array
    sigma: Array
    """SD of the effects: none where the parameter acts alone and along a straight line."""
    sigma_conf: Array
    trajectories: int
    planned: int


def screening(inputs: Array, values: Array) -> tuple[Screening | None, str]:
    """Morris' measures of an output (m,) at his trajectories (m, d) in their order, NaN where a
    run failed: its trajectory is left out whole.  An effect is what the output changes by as a
    parameter goes from its lowest level to its highest, the 12.5 % and the 87.5 % quantile.
    Without them a text says why there are none.  Campolongo, Cariboni and Saltelli 2007 (Environ
    Model Softw 22:1509)."""
    size = inputs.shape[1] + 1
    blocks, x = values.reshape(-1, size), inputs.reshape(-1, size, size - 1)
    fine = np.isfinite(blocks).all(axis=1)
    kept, planned = int(fine.sum()), len(blocks)
    if planned - kept > MOST_LOST * planned:
        return None, (
            f"no effects: {planned - kept} of {planned} trajectories hold a run without a value, "
            f"more than {MOST_LOST:.0%}"
        )
    if kept < 2:
        return None, f"no effects: {kept} trajectories are too few; at least 2"
    return _screening(x[fine], blocks[fine], planned), ""


def _screening(x: Array, values: Array, planned: int) -> Screening:
    require("Morris' screening", "SALib")
    from SALib.analyze.morris import analyze

    n, d = len(x), x.shape[2]
    found = analyze(
        problem(d),
        x.reshape(-1, d),  # of which it asks but who goes up and who down
        values.ravel(),
        num_resamples=RESAMPLES,
        conf_level=CONFIDENCE,
        num_levels=LEVELS,
        seed=SEED,
    )
    # SALib gives no interval of sigma: that of the trajectories, drawn again
    step = np.sign(np.diff(x, axis=1))
    effects = np.diff(values, axis=1)[:, :, None] * step / (LEVELS / 2 / (LEVELS - 1))
    drawn = np.random.default_rng(SEED).integers(0, n, (RESAMPLES, n))
    sds = effects.sum(axis=1)[drawn].std(axis=1, ddof=1)
    mu, mu_star, conf, sigma = (
        np.asarray(found[name], dtype=float) for name in ("mu", "mu_star", "mu_star_conf", "sigma")
    )
    return Screening(mu, mu_star, conf, sigma, NORMAL * sds.std(axis=0), n, planned)


def _indices(kept: Array, planned: int, dimensions: int, second_order: bool) -> Indices:
    require("Sobol's indices", "SALib")
    from SALib.analyze.sobol import analyze

    sobol = analyze(
        problem(dimensions),
        kept.ravel(),
        calc_second_order=second_order,
        num_resamples=RESAMPLES,
        conf_level=CONFIDENCE,
        seed=SEED,
    )
    second = np.asarray(sobol["S2"]) if second_order else None
    first, first_conf, total, total_conf = (
        np.asarray(sobol[name], dtype=float) for name in ("S1", "S1_conf", "ST", "ST_conf")
    )
    return Indices(first, first_conf, total, total_conf, second, len(kept), planned)


@dataclass(frozen=True)
class Slopes:
    """A linear fit: SDs of the output for one SD of each parameter, their standard errors, the
    share of the variance that the fit explains, and the RMS that it leaves, in the output's
    unit."""

    slope: Array
    error: Array
    r2: float
    rms: float


def slopes(inputs: Array, values: Array) -> Slopes | None:
    """Standardised regression coefficients of (n, d) inputs; None with too few runs, or where
    nothing changes."""
    x, y = _significant(inputs, values)
    n, d = x.shape
    if n < d + 3 or np.ptp(y) == 0 or (np.ptp(x, axis=0) == 0).any():
        return None
    sd = float(y.std())
    x, y = _standard(x), _standard(y[:, None])[:, 0]
    if np.linalg.matrix_rank(x) < d:
        return None
    coefficients = _least_squares(x, y)
    left = float(((y - x @ coefficients) ** 2).sum())
    error = np.sqrt(left / (n - d - 1) * np.diag(np.linalg.inv(x.T @ x)))
    r2 = 1 - left / float((y**2).sum())
    return Slopes(coefficients, error, r2, sd * float(np.sqrt(left / n)))


def too_few_for_indices(indices: Indices, names: Sequence[str]) -> str:
    """Say which of Sobol's indices is known least, where its interval is wide; else nothing."""
    widths = np.maximum(indices.first_conf, indices.total_conf)
    i = int(np.nanargmax(widths)) if np.isfinite(widths).any() else 0
    if not widths[i] > WIDE:
        return ""
    return (
        f"Sobol's indices: that of {names[i]} is known within ±{widths[i]:.2g} by {indices.blocks} "
        f"blocks of runs; some {_needed(indices.blocks, widths[i])} would bring it to ±{WIDE:g}"
    )


def too_few_for_slopes(slopes: Slopes, runs: int, names: Sequence[str]) -> str:
    """Say which slope is known least, where two standard errors are wide; else nothing."""
    widths = 2 * slopes.error
    i = int(widths.argmax())
    if not widths[i] > WIDE:
        return ""
    return (
        f"slopes: that of {names[i]} is known within ±{widths[i]:.2g} SD by {runs} runs; some "
        f"{_needed(runs, widths[i])} would bring it to ±{WIDE:g}"
    )


def too_few_for_ends(runs: int, middle: float = 0.95) -> str:
    """Say that the ends of the middle part are those of the sample; nothing with enough runs: the
    least of which, with 95 % confidence, one lies beyond each end."""
    needed = ceil(log(1 - CONFIDENCE) / log((1 + middle) / 2))
    if runs >= needed:
        return ""
    return (
        f"middle {100 * middle:g} %: its ends are hardly known by {runs} runs, of which none may "
        f"lie beyond the true ones; it takes {needed}"
    )


def _needed(count: int, width: float) -> int:
    """How many bring an interval, which narrows as the square root, to WIDE; two digits."""
    return int(float(f"{count * (width / WIDE) ** 2:.2g}"))


def _significant(inputs: Array, values: Array) -> tuple[Array, Array]:
    finite = np.isfinite(values)
    return inputs[finite], values[finite]


def _standard(x: Array) -> Array:
    out: Array = (x - x.mean(axis=0)) / x.std(axis=0)
    return out


@dataclass(frozen=True)
class ResponseSurface:
    """A quadratic in all parameters by least squares; `r2`: of the runs it was fitted to, and
    `held_out` of runs that it was not (tenths left out in turn); `rms`: what it leaves of the runs,
    in the output's unit; `span`: highest less lowest value of each parameter."""

    mean: Array
    sd: Array
    span: Array
    coefficients: Array
    r2: float
    held_out: float
    rms: float
    runs: int

    @property
    def pairs(self) -> dict[tuple[int, int], float]:
        """By pair of parameters, what the output changes by as both go from lowest to highest, less
        the sum of what it changes by as each goes alone; the strongest first."""
        d = len(self.mean)
        places = combinations_with_replacement(range(-1, d), 2)
        scale = self.span / self.sd
        changes = {
            (i, j): float(c * scale[i] * scale[j])
            for (i, j), c in zip(places, self.coefficients, strict=True)
            if 0 <= i < j
        }
        return dict(sorted(changes.items(), key=lambda pair: -abs(pair[1])))

    def __call__(self, inputs: Array) -> Array:
        """The surface's answers (n,) at inputs (n, d)."""
        out: Array = _quadratic((np.asarray(inputs) - self.mean) / self.sd) @ self.coefficients
        return out


def surface(inputs: Array, values: Array, together: int = 1) -> ResponseSurface | None:
    """The response surface through values (n,) at inputs (n, d); None with fewer runs than twice
    the terms, or where an input stays.

    So many rows after one another are held out `together`: Saltelli's points of a block differ in
    one parameter alone, and would tell each other's values."""
    x, y = _significant(inputs, values)
    groups = np.flatnonzero(np.isfinite(values)) // together
    n, d = x.shape
    terms = (d + 1) * (d + 2) // 2
    if n < 2 * terms or np.ptp(y) == 0 or (np.ptp(x, axis=0) == 0).any():
        return None
    mean, sd = x.mean(axis=0), x.std(axis=0)
    basis = _quadratic((x - mean) / sd)
    if np.linalg.matrix_rank(basis) < terms:  # an axis with two values has no curvature
        return None
    coefficients = _least_squares(basis, y)
    predicted = np.empty(n)
    fold = (np.random.default_rng(SEED).permutation(groups.max() + 1) % FOLDS)[groups]
    for i in range(FOLDS):
        out = fold == i
        predicted[out] = basis[out] @ _least_squares(basis[~out], y[~out])
    fitted = basis @ coefficients
    rms = float(np.sqrt(np.mean((y - fitted) ** 2)))
    r2, held_out = _r2(y, fitted), _r2(y, predicted)
    return ResponseSurface(mean, sd, np.ptp(x, axis=0), coefficients, r2, held_out, rms, n)


def _least_squares(basis: Array, values: Array) -> Array:
    return np.asarray(np.linalg.lstsq(basis, values, rcond=None)[0], dtype=float)


def _quadratic(x: Array) -> Array:
    """1, x and all products of two: (n, d) -> (n, (d + 1)(d + 2) / 2)."""
    full = np.hstack([np.ones((len(x), 1)), x])
    pairs = combinations_with_replacement(range(full.shape[1]), 2)
    return np.column_stack([full[:, i] * full[:, j] for i, j in pairs])


def _r2(values: Array, predicted: Array) -> float:
    gap, spread = ((values - predicted) ** 2).sum(), ((values - values.mean()) ** 2).sum()
    return float(1 - gap / spread)
