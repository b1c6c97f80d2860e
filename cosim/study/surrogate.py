"""A Gaussian process fitted to a study's table, which answers new points with a spread.

Inputs are standardised; the kernel is a Matern one of smoothness 5/2 with a length for each
parameter and white noise, its numbers by maximum likelihood (Rasmussen and Williams 2006, Gaussian
Processes for Machine Learning), of scikit-learn.  How far to trust it is told by runs that it was
not fitted to: parts of the table left out in turn, with the kernel's numbers found again,

    Q2 = 1 - sum of squared errors / sum of squares about the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.errors import InputError
from cosim.extras import require
from cosim.port import Array, Ints
from cosim.study.answers import NORMAL, SEED

if TYPE_CHECKING:
    import pandas as pd

LEAST_Q2 = 0.8
"""Below it a surrogate is no stand-in for the model, and refused."""
FOLDS = 5
LEAST_RUNS, MOST_RUNS = 20, 600
"""Runs that it is fitted to: fewer tell nothing, more take minutes and are thinned out evenly."""
LONGEST, NOISE = (1e-2, 1e3), (1e-10, 1e0)
"""Bounds of a length, in SDs of the parameter, and of the noise's share of the variance."""


@dataclass(frozen=True)
class Surrogate:
    """What stands in for the model between a study's runs."""

    output: str
    unit: str
    names: tuple[str, ...]
    """The parameters' names, in the order of the study."""
    low: Array
    high: Array
    """(d,) ends of the parameters' values in the runs, beyond which it does not answer."""
    q2: float
    """The share of the variance that is explained of runs held out."""
    rms: float
    """The root mean square of the errors at runs held out, in the output's unit."""
    covered: float
    """The part of the runs held out whose 95 % interval holds their value."""
    runs: int
    """How many it was fitted to."""
    _process: Any
    _mean: Array
    _sd: Array

    def __call__(self, points: pd.DataFrame) -> pd.DataFrame:
        """Its answers: columns mean and sd, in the output's unit, a row for each of the points,
        whose columns are the parameters in the study's units.

        Raises InputError for a parameter that is missing and for a point beyond the runs."""
        import pandas as pd

        x = self._inputs(points)
        mean, sd = self._process.predict((x - self._mean) / self._sd, return_std=True)
        return pd.DataFrame({"mean": mean, "sd": sd}, index=points.index)

    def _inputs(self, points: pd.DataFrame) -> Array:
        if absent := [name for name in self.names if name not in points.columns]:
            raise InputError(f"points: lack the column {', '.join(absent)}")
        try:
            x = points[list(self.names)].to_numpy(float)
        except ValueError as error:
            raise InputError(f"points: {error}") from None
        slack = 1e-9 * (self.high - self.low)
        beyond = ~((x >= self.low - slack) & (x <= self.high + slack))
        if beyond.any():
            row, i = map(int, np.argwhere(beyond)[0])
            raise InputError(
                f"points: row {row + 1}: {self.names[i]} = {x[row, i]:g} lies outside of the runs "
                f"of the study, {self.low[i]:g} to {self.high[i]:g}, and there it knows nothing"
            )
        return x


def fit_surrogate(
    named: tuple[str, str, tuple[str, ...]], x: Array, y: Array, together: int, allow_poor: bool
) -> Surrogate:
    """The surrogate of an output, `named` with its unit and its d parameters, fitted to the values
    y (n,), NaN where a run failed, at inputs x (n, d); so many rows after one another are held out
    `together`.

    Raises InputError where scikit-learn is missing, where there are too few runs and, unless
    `allow_poor`, where Q2 is below LEAST_Q2."""
    require("a surrogate", "sklearn")
    output, unit, names = named
    kept = np.flatnonzero(np.isfinite(y))
    if len(kept) < LEAST_RUNS or not names:
        raise InputError(
            f"{output}: a surrogate needs at least {LEAST_RUNS} runs with this number, and there "
            f"are {len(kept)}"
        )
    groups = kept // together
    if len(kept) > MOST_RUNS:
        at = np.linspace(0, len(kept) - 1, MOST_RUNS).round().astype(int)
        kept, groups = kept[at], groups[at]
    x, y = x[kept], y[kept]
    if np.ptp(y) == 0:
        raise InputError(f"{output}: is the same in every run; there is nothing to fit")
    predicted, spread = _held_out(x, y, groups)
    errors = y - predicted
    q2 = float(1 - (errors**2).sum() / ((y - y.mean()) ** 2).sum())
    if not q2 >= LEAST_Q2 and not allow_poor:
        raise InputError(
            f"{output}: a Gaussian process of {len(y)} runs explains {q2:.0%} of runs held out "
            f"(Q2 = {q2:.2f}), and a stand-in for the model should explain {LEAST_Q2:.0%}; take "
            "more runs or fewer parameters, or ask for it nevertheless (allow_poor)"
        )
    mean, sd = x.mean(axis=0), x.std(axis=0)
    return Surrogate(
        output,
        unit,
        names,
        x.min(axis=0),
        x.max(axis=0),
        q2,
        float(np.sqrt(np.mean(errors**2))),
        float(np.mean(np.abs(errors) <= NORMAL * spread)),
        len(y),
        _process((x - mean) / sd, y),
        mean,
        sd,
    )


def _held_out(x: Array, y: Array, groups: Ints) -> tuple[Array, Array]:
    """The answers (n,) at runs that a process was not fitted to, and their SDs; rows of a group
    are held out together."""
    each, number = np.unique(groups, return_inverse=True)
    fold = (np.random.default_rng(SEED).permutation(len(each)) % FOLDS)[number]
    predicted, spread = np.empty_like(y), np.empty_like(y)
    for i in range(FOLDS):
        out = fold == i
        mean, sd = x[~out].mean(axis=0), x[~out].std(axis=0)
        sd[sd == 0] = 1.0
        process = _process((x[~out] - mean) / sd, y[~out])
        predicted[out], spread[out] = process.predict((x[out] - mean) / sd, return_std=True)
    return predicted, spread


def _process(x: Array, y: Array) -> Any:
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    kernel = ConstantKernel(1.0, (1e-2, 1e4)) * Matern(
        np.ones(x.shape[1]), LONGEST, nu=2.5
    ) + WhiteKernel(1e-4, NOISE)
    process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=SEED)
    with warnings.catch_warnings():  # a length at its bound is a parameter that does nothing
        warnings.simplefilter("ignore", ConvergenceWarning)
        return process.fit(x, y)
