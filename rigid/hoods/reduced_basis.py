"""Functions that the potential of a reduced hood is a sum of, with their derivatives.

See `rigid.hoods.reduced`: monomials of scaled angles, and products of four springs' functions of
scaled tensions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leg2poly
from numpy.typing import NDArray

from cosim.kernels.kernel import compile_kernel
from cosim.port import Array

Numbers = NDArray[np.intp]
Functions = tuple[Array, Array, Array]
"""(..., n, K): values, first and second derivatives of K functions of each of n variables."""


class Basis(NamedTuple):
    """Values (..., A), first (..., A, n) and second (..., A, n, n) derivatives of A products."""

    value: Array
    slope: Array
    curve: Array


def monomials(powers: Numbers, at: Array, curved: bool = True) -> Basis:
    """The functions prod_j at_j^p_aj with powers (A, n) at (..., n); unless `curved`, second
    derivatives are left out (zero)."""
    return _products(powers, powers_of(int(powers.max(initial=0)), at), curved)


def powers_of(most: int, at: Array) -> Functions:
    """Return x^0 to x^most of `at` (...), and their first and second derivatives, (..., most + 1)
    each."""
    x = at[..., None] ** np.arange(most + 1)
    p = np.arange(most + 1)
    down, twice = np.zeros_like(x), np.zeros_like(x)
    down[..., 1:] = p[1:] * x[..., :-1]
    twice[..., 2:] = p[2:] * p[1:-1] * x[..., :-2]
    return x, down, twice


def legendre(degrees: Numbers, at: Array) -> Basis:
    """The functions prod_j P_(d_aj)(at_j), Legendre polynomials of degrees (A, n), at (..., n)."""
    return _products(degrees, legendre_of(int(degrees.max(initial=0)), at), curved=True)


def legendre_of(most: int, at: Array) -> Functions:
    """Return P_0 to P_most of `at` (...), and their first and second derivatives, (..., most + 1)
    each, by the recurrences (k + 1) P_k+1 = (2k + 1) x P_k - k P_k-1 and P'_k+1 = P'_k-1 + (2k + 1)
    P_k."""
    value, slope, curve = (np.zeros((*at.shape, most + 1)) for _ in range(3))
    value[..., 0] = 1.0
    for k in range(most):
        behind = [x[..., k - 1] if k else 0.0 for x in (value, slope, curve)]
        value[..., k + 1] = ((2 * k + 1) * at * value[..., k] - k * behind[0]) / (k + 1)
        slope[..., k + 1] = behind[1] + (2 * k + 1) * value[..., k]
        curve[..., k + 1] = behind[2] + (2 * k + 1) * slope[..., k]
    return value, slope, curve


def to_powers(degrees: Numbers) -> Array:
    """The matrix (A, A) that writes products of Legendre polynomials as sums of products of powers,
    for degrees (A, n) that hold all lower ones of each."""
    most = int(degrees.max(initial=0))
    table = np.zeros((most + 1, most + 1))
    for k, row in enumerate(np.eye(most + 1)):
        table[k, : k + 1] = leg2poly(row[: k + 1])
    out: Array = table[degrees[:, None], degrees[None]].prod(axis=2)
    return out


def loadings(terms: Numbers, at: Array, toe: float, curved: bool = True) -> Basis:
    """The functions prod_m f_(q_gm)(at_m) with terms (G, m) of 0 to 3 at (..., m); see the
    module."""
    return _products(terms, springs_of(at, toe), curved)


def springs_of(at: Array, toe: float) -> Functions:
    """Return 1, x, x^2 and (x + toe) log(1 + x / toe) - x of `at` (...) N, and their first and
    second derivatives, (..., 4) each; `toe` in N."""
    value, slope, curve = (np.zeros((*at.shape, 4)) for _ in range(3))
    log = np.log1p(at / toe)
    value[..., 0], value[..., 1], value[..., 2] = 1.0, at, at**2
    value[..., 3] = (at + toe) * log - at
    slope[..., 1], slope[..., 2], slope[..., 3] = 1.0, 2 * at, log
    curve[..., 2], curve[..., 3] = 2.0, 1 / (at + toe)
    return value, slope, curve


def _products(index: Numbers, functions: Functions, curved: bool) -> Basis:
    """Products of one function of each of n variables: `index` (A, n) chooses among those whose
    values and first and second derivatives are `functions`, (..., n, k) each."""
    n = index.shape[1]
    chosen = [[f[..., j, :][..., index[:, j]] for j in range(n)] for f in functions]

    def product(order: NDArray[np.int_]) -> Array:
        out: Array = chosen[int(order[0])][0]
        for j in range(1, n):
            out = out * chosen[int(order[j])][j]
        return out

    one = np.eye(n, dtype=int)
    value = product(0 * one[0])
    slope = np.stack([product(row) for row in one], axis=-1)
    curve = np.zeros((*value.shape, n, n) if curved else (n, n))
    for i in range(n if curved else 0):
        for k in range(i + 1):
            curve[..., i, k] = curve[..., k, i] = product(one[i] + one[k])
    return Basis(value, slope, curve)


@compile_kernel
def derivatives(index: NDArray[np.int64], table: Array) -> Array:
    """Return A products of one function of each of n variables with all derivatives, (1 + n, 1 + n,
    A): [0, 0] the values, [1 + i, 0] derivatives by variable i, [1 + i, 1 + k] by i and k.

    index (A, n): which function of each variable; table (3, n, K): all functions' values and first
    and second derivatives."""
    count, n = index.shape
    out = np.ones((1 + n, 1 + n, count))
    for i in range(1 + n):
        for k in range(1 + i):
            for j in range(n):
                order = int(i == j + 1) + int(k == j + 1)
                out[i, k] *= table[order, j][index[:, j]]
            out[k, i] = out[i, k]
    return out


def orders(factor: Array) -> Array:
    """The factors (n,) of the variables, (3, n, 1), to the powers 0, 1 and 2 of a derivative's
    order."""
    return np.stack([np.ones_like(factor), factor, factor**2])[..., None]


def unscale(basis: Basis, scale: Array) -> Basis:
    """Derivatives by what was divided by the scale (n,)."""
    return Basis(basis.value, basis.slope / scale, basis.curve / (scale[:, None] * scale[None, :]))
