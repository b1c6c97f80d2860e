"""Points of the unit cube to try, by seed: at random, Latin hypercube, Sobol, Saltelli, Morris."""

from __future__ import annotations

from itertools import product
from typing import Literal, get_args

import numpy as np

from cosim.errors import InputError
from cosim.extras import require
from cosim.port import Array
from cosim.study.distributions import Law, Word, is_axis

Kind = Literal["random", "latin_hypercube", "sobol", "saltelli", "morris"]
KINDS: tuple[Kind, ...] = get_args(Kind)
POWERS_OF_TWO: tuple[Kind, ...] = ("sobol", "saltelli")
"""Their sequences are balanced for such counts alone (Owen 2020, arXiv:2008.08051)."""


LEVELS = 4
"""Values of each parameter in Morris' scheme: the quantiles at the middles of as many parts."""
SCHEMES: tuple[Kind, ...] = ("saltelli", "morris")
"""Those that sample all parameters together, block after block."""


def block(dimensions: int, second_order: bool) -> int:
    """Points of Saltelli's scheme for each of its base points: A, A with a column of B for each
    parameter (and B with one of A for indices of second order), B."""
    return (2 if second_order else 1) * dimensions + 2


def count_points(kind: Kind, dimensions: int, n: int, second_order: bool) -> int:
    """How many points `unit_points` gives."""
    return n * points_together(kind, dimensions, second_order)


def points_together(kind: Kind, dimensions: int, second_order: bool) -> int:
    """How many points in turn differ in few parameters: Saltelli's block, Morris' trajectory."""
    if kind == "saltelli":
        return block(dimensions, second_order)
    return dimensions + 1 if kind == "morris" else 1


def check_sampling(kind: Kind, n: int) -> None:
    """Check that points of a kind can be made, and so many.

    Raises InputError for a count that the sequence is not balanced for, and where a library is
    missing."""
    if kind in POWERS_OF_TWO and n & (n - 1):
        below = 1 << (n.bit_length() - 1)
        raise InputError(
            f"sampling.n = {n}: {kind} needs a power of 2, for example {below} or {2 * below}"
        )
    if kind in SCHEMES:
        require(f"sampling.kind = {kind!r}", "SALib")


def unit_points(kind: Kind, dimensions: int, n: int, seed: int, second_order: bool) -> Array:
    """Points (m, dimensions) inside (0, 1); m is n, of Saltelli's scheme (Comput Phys Commun
    145:280, 2002) n `block`s, of Morris' (Technometrics 33:161, 1991) n trajectories, in which one
    parameter after the other goes half of the `LEVELS` up or down.  Raises InputError as
    `check_sampling` does."""
    check_sampling(kind, n)
    sampled = _points(kind, dimensions, n, seed, second_order)
    tiny = np.finfo(float).eps
    return np.clip(sampled, tiny, 1 - tiny)


def _points(kind: Kind, dimensions: int, n: int, seed: int, second_order: bool) -> Array:
    from scipy.stats import qmc

    if kind == "random":
        return np.random.default_rng(seed).random((n, dimensions))
    if kind == "latin_hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, seed=seed).random(n))
    if kind == "sobol":
        return np.asarray(qmc.Sobol(dimensions, seed=seed).random(n))
    if kind == "morris":
        from SALib.sample.morris import sample as trajectories

        levels = trajectories(problem(dimensions), n, num_levels=LEVELS, seed=seed)
        return np.asarray((levels * (LEVELS - 1) + 0.5) / LEVELS)
    from SALib.sample.sobol import sample

    sampled = sample(problem(dimensions), n, calc_second_order=second_order, seed=seed)
    return np.asarray(sampled)


def problem(dimensions: int) -> dict[str, object]:
    """What SALib asks of so many parameters on the unit cube."""
    names = [f"x{i}" for i in range(dimensions)]
    return {"num_vars": dimensions, "names": names, "bounds": [[0.0, 1.0]] * dimensions}


def points(laws: tuple[Law, ...], samples: Array | None) -> list[tuple[Word, ...]]:
    """The values of every run: for each sample (a row of `samples`, a column for each
    distribution) all of the axes' combinations, the last axis fastest."""
    drawn = [law for law in laws if not is_axis(law)]
    columns = [
        law.quantile(samples[:, i]).tolist() for i, law in enumerate(drawn) if samples is not None
    ]
    rows = list(zip(*columns, strict=True)) if columns else [()]
    steps = list(product(*(law.values for law in laws if is_axis(law))))
    return [_interleave(laws, row, step) for row in rows for step in steps]


def _interleave(laws: tuple[Law, ...], row: tuple[float, ...], step: tuple[Word, ...]) -> tuple:
    """The values in the order of the laws."""
    sampled, stepped = iter(row), iter(step)
    return tuple(next(stepped if is_axis(law) else sampled) for law in laws)
