"""The inner loops of the elements and of the assembly, compiled by numba where it is installed.

Every element and every entry of the matrix is worked on by itself and in the same order, so that
any number of threads gives the same bits.  Without numba `fe_solver.elements.shell` and numpy do
the same.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp

from cosim.errors import InputError
from cosim.kernels import kernel
from cosim.port import Array, Ints

Function = TypeVar("Function", bound=Callable[..., Any])

COMPILED = kernel.HAS_NUMBA and not os.environ.get("FE_SOLVER_NO_NUMBA")
THREADS = "FE_SOLVER_THREADS"
MOST_THREADS = 256
PAYS = 1000
"""Elements from which a second thread pays."""


def compile_kernel(function: Function) -> Function:
    """The function as a kernel (`cosim.kernels.kernel`), unless compiled ones are switched off."""
    return kernel.compile_kernel(function) if COMPILED else function


def compile_part(function: Function) -> Function:
    """The function for other kernels of its file (`cosim.kernels.kernel.compile_part`)."""
    return kernel.compile_part(function) if COMPILED else function


def thread_count() -> int:
    """Threads of a large assembly: FE_SOLVER_THREADS, else the cores at hand up to four.  Raises
    InputError for a wish that is no positive whole number."""
    wish = os.environ.get(THREADS)
    if not wish:
        return min(4, os.cpu_count() or 1)
    if not (wish.isascii() and wish.isdigit() and 0 < int(wish) <= MOST_THREADS):
        raise InputError(f"{THREADS}={wish}: expected a whole number from 1 to {MOST_THREADS}")
    return int(wish)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="assembly")


def in_parallel(work: Callable[[int, int], None], count: int, pays: int) -> None:
    """Do work(first, last) for all of `count` items, in equal parts side by side."""
    threads = thread_count() if count >= pays else 1
    if threads == 1:
        work(0, count)
        return
    ends = [count * i // threads for i in range(threads + 1)]
    for done in [_pool(threads).submit(work, a, b) for a, b in pairwise(ends)]:
        done.result()


def sum_entries(start: Ints, gather: Ints, values: Array) -> Array:
    """The sums (m,) of values[gather[start[k]:start[k + 1]]], each taken in order."""
    out = np.zeros(len(start) - 1)
    if COMPILED:
        in_parallel(lambda a, b: _gather(a, b, start, gather, values, out), len(out), 400 * PAYS)
        return out
    which = np.repeat(np.arange(len(out)), np.diff(start))
    return np.bincount(which, weights=values[gather], minlength=len(out)).astype(float, copy=False)


@compile_kernel
def _gather(first: int, last: int, start: Ints, gather: Ints, values: Array, out: Array) -> None:
    for k in range(first, last):
        total = 0.0
        for i in range(start[k], start[k + 1]):
            total += values[gather[i]]
        out[k] = total


def spread(which: Ints, weights: Array, hessian: Array, count: int) -> Array:
    """The sums (count, m, 3, m, 3) of weights[k, a] weights[k, b] hessian[k] over those k whose
    `which` (k,) is the same; weights (k, m), hessian (k, 3, 3)."""
    k, m = weights.shape
    if COMPILED:
        out = np.zeros((count, m, 3, m, 3))
        _spread(which, weights, hessian, out)
        return out
    products = np.einsum("ka,kb,kij->kaibj", weights, weights, hessian).reshape(k, -1)
    sums = sp.csr_array((np.ones(k), (which, np.arange(k))), (count, k))
    return (sums @ products).reshape(count, m, 3, m, 3)


@compile_kernel
def _spread(which: Ints, weights: Array, hessian: Array, out: Array) -> None:
    m = weights.shape[1]
    for k in range(len(which)):
        e = which[k]
        for a in range(m):
            for b in range(m):
                w = weights[k, a] * weights[k, b]
                for i in range(3):
                    for j in range(3):
                        out[e, a, i, b, j] += w * hessian[k, i, j]


Tables = tuple[Array, Array, Array]
"""What makes the strains at the Gauss points from the samples: membrane (ne, g, 3, 5 or 24),
bending (ne, g, 3, 3) and shear (ne, g, 2, 4 or 12)."""
Carried = tuple[Array, Array]
"""The mid-surface's height (ne, k) m over the nodes, and elements' directors over the nodes'
(ne, k)."""


def strains(
    samples: Array, y: Array, carried: Carried, tables: Tables, offset: Array
) -> tuple[Array, Array]:
    """The mid-surface's y (ne, 2k, 3), seen from its first node, of the nodes', and the strains
    (ne, g, 8) there; `offset` (ne, g, 8) is taken off."""
    middle, strain = np.empty(y.shape), np.empty(offset.shape)
    known = (0,) * carried[0].shape[1]

    def work(first: int, last: int) -> None:
        _strains(first, last, known, samples, y, *carried, *tables, offset, middle, strain)

    in_parallel(work, len(y), PAYS)
    return middle, strain


@compile_kernel
def _strains(
    first: int,
    last: int,
    known: tuple[int, ...],
    samples: Array,
    y: Array,
    height: Array,
    mitre: Array,
    membrane: Array,
    bending: Array,
    shear: Array,
    offset: Array,
    middle: Array,
    strain: Array,
) -> None:
    stretch, m = membrane.shape[3], len(samples)
    nodes = len(known)  # the length of a tuple is known to the compiler, which unrolls by it
    value = np.empty(m)
    for e in range(first, last):
        _to_middle(y[e], height[e], mitre[e], middle[e])
        # the samples: of the positions alone, then of positions times directors
        for i in range(m):
            total = 0.0
            for a in range(nodes):
                for k in range(3):
                    part = 0.0
                    if i < stretch:
                        for b in range(nodes):
                            part += 0.5 * samples[i, a, b] * middle[e, b, k]
                    else:
                        for b in range(nodes, 2 * nodes):
                            part += samples[i, a, b] * middle[e, b, k]
                    total += middle[e, a, k] * part
            value[i] = total
        _combine(membrane[e], bending[e], shear[e], value, strain[e])
        for g in range(strain.shape[1]):
            for c in range(8):
                strain[e, g, c] -= offset[e, g, c]


def strain_changes(samples: Array, y: Array, dy: Array, carried: Carried, tables: Tables) -> Array:
    """The derivatives (ne, g, 8) of the strains at nodes' y (ne, 2k, 3) along dy (ne, 2k, 3)."""
    out = np.empty((*tables[0].shape[:2], 8))

    def work(first: int, last: int) -> None:
        _strain_changes(first, last, samples, y, dy, *carried, *tables, out)

    in_parallel(work, len(y), PAYS)
    return out


@compile_kernel
def _strain_changes(
    first: int,
    last: int,
    samples: Array,
    y: Array,
    dy: Array,
    height: Array,
    mitre: Array,
    membrane: Array,
    bending: Array,
    shear: Array,
    out: Array,
) -> None:
    nodes, stretch, m = height.shape[1], membrane.shape[3], len(samples)
    u, du = np.empty((2 * nodes, 3)), np.empty((2 * nodes, 3))
    products, value = np.empty((nodes, nodes)), np.empty(m)
    for e in range(first, last):
        _to_middle(y[e], height[e], mitre[e], u)
        _to_middle(dy[e], height[e], mitre[e], du)
        for near in range(0, nodes + 1, nodes):  # of positions alone, then with directors
            for a in range(nodes):
                for b in range(nodes):
                    x, d = near + b, 0.0
                    for k in range(3):
                        d += u[a, k] * du[x, k] + (du[a, k] * u[x, k] if near else 0.0)
                    products[a, b] = d
            for i in range(stretch if near else 0, m if near else stretch):
                total = 0.0
                for a in range(nodes):
                    for b in range(nodes):
                        total += samples[i, a, near + b] * products[a, b]
                value[i] = total
        _combine(membrane[e], bending[e], shear[e], value, out[e])


@compile_part
def _to_middle(y: Array, height: Array, mitre: Array, out: Array) -> None:
    """Set `out` (2k, 3) to y of the mid-surface, seen from its first node, by that of the nodes."""
    nodes = len(height)
    for a in range(nodes):
        for k in range(3):
            d = y[nodes + a, k] * mitre[a]
            out[nodes + a, k] = d
            out[a, k] = y[a, k] + height[a] * d
    for a in range(nodes - 1, -1, -1):
        for k in range(3):
            out[a, k] -= out[0, k]


@compile_part
def _combine(membrane: Array, bending: Array, shear: Array, value: Array, strain: Array) -> None:
    """Set the `strain` (g, 8) of an element's Gauss points by its samples' values (m,)."""
    stretch, slips, m = membrane.shape[2], shear.shape[2], len(value)
    for g in range(len(strain)):
        for c in range(3):
            total = 0.0
            for i in range(stretch):
                total += membrane[g, c, i] * value[i]
            strain[g, c] = total
            total = 0.0
            for i in range(3):
                total += bending[g, c, i] * value[stretch + 3 * g + i]
            strain[g, 3 + c] = total
        for c in range(2):
            total = 0.0
            for i in range(slips):
                total += shear[g, c, i] * value[m - slips + i]
            strain[g, 6 + c] = total


def forces(
    samples: Array, middle: Array, carried: Carried, tables: Tables, resultant: Array
) -> Array:
    """The gradient (ne, 2k, 3) by the nodes' y of resultant (ne, g, 8) times the strains, at y (ne,
    2k, 3) of the mid-surface."""
    out = np.empty(middle.shape)

    def work(first: int, last: int) -> None:
        _forces(first, last, samples, middle, *carried, *tables, resultant, out)

    in_parallel(work, len(middle), PAYS)
    return out


@compile_kernel
def _forces(
    first: int,
    last: int,
    samples: Array,
    middle: Array,
    height: Array,
    mitre: Array,
    membrane: Array,
    bending: Array,
    shear: Array,
    resultant: Array,
    out: Array,
) -> None:
    size, stretch = middle.shape[1], membrane.shape[3]
    nodes = size // 2
    G, stress = np.zeros((size, size)), np.empty(len(samples))
    for e in range(first, last):
        _sample_stress(e, membrane, bending, shear, resultant, stress)
        _geometric(samples, stretch, stress, G)
        for a in range(size):
            for k in range(3):
                value = 0.0
                for b in range(size):
                    value += G[a, b] * middle[e, b, k]
                out[e, a, k] = value
        for a in range(nodes):
            for k in range(3):
                carried = out[e, nodes + a, k] + height[e, a] * out[e, a, k]
                out[e, nodes + a, k] = carried * mitre[e, a]


@compile_part
def _sample_stress(
    e: int, membrane: Array, bending: Array, shear: Array, resultant: Array, stress: Array
) -> None:
    """Set the `stress` (m,) of an element's samples from the resultants of its Gauss points."""
    stretch, slips, m = membrane.shape[3], shear.shape[3], len(stress)
    stress[:] = 0.0
    for g in range(resultant.shape[1]):
        for c in range(3):
            for i in range(stretch):
                stress[i] += membrane[e, g, c, i] * resultant[e, g, c]
            for i in range(3):
                stress[stretch + 3 * g + i] += bending[e, g, c, i] * resultant[e, g, 3 + c]
        for c in range(2):
            for i in range(slips):
                stress[m - slips + i] += shear[e, g, c, i] * resultant[e, g, 6 + c]


@compile_part
def _geometric(samples: Array, membrane: int, stress: Array, out: Array) -> None:
    """Set `out` (2k, 2k) to sum stress (m,) times samples, whose lower right block is zero."""
    nodes = out.shape[0] // 2
    out[:, :] = 0.0
    for i in range(membrane):
        for a in range(nodes):
            for b in range(nodes):
                out[a, b] += stress[i] * samples[i, a, b]
    for i in range(membrane, len(stress)):
        for a in range(nodes):
            for b in range(nodes, 2 * nodes):
                out[a, b] += stress[i] * samples[i, a, b]
    for a in range(nodes):
        for b in range(nodes, 2 * nodes):
            out[b, a] = out[a, b]


def element_blocks(
    samples: Array,
    middle: Array,
    carried: Carried,
    tables: Tables,
    resultant: Array,
    stiffness: tuple[Array, Array],
    bases: tuple[Array, Array],
) -> Array:
    """The tangent (ne, 5k, 5k) of each element in its nodes' bases: y (ne, 2k, 3) of the
    mid-surface, the resultants (ne, g, 8) that make the geometric part, stiffness (ne, g, 8, 8) and
    area (ne, g) of the Gauss points, bases A (ne, k, 3, 3) and T (ne, k, 3, 2)."""
    size = 5 * carried[0].shape[1]
    out = np.empty((len(middle), size, size))

    def work(first: int, last: int) -> None:
        what = samples, middle, *carried, *tables, resultant, *stiffness, *bases
        _blocks(first, last, *what, out)

    in_parallel(work, len(middle), PAYS)
    return out


@compile_kernel
def _blocks(
    first: int,
    last: int,
    samples: Array,
    y: Array,
    height: Array,
    mitre: Array,
    membrane: Array,
    bending: Array,
    shear: Array,
    resultant: Array,
    stiffness: Array,
    weight: Array,
    A: Array,
    directors: Array,
    out: Array,
) -> None:
    nodes, points, m = height.shape[1], stiffness.shape[1], len(samples)
    stress, C, T = np.empty(m), np.empty(8), np.empty((nodes, 3, 2))
    stretch, slips = membrane.shape[3], shear.shape[3]
    size, shears = 5 * nodes, m - slips
    B = np.empty((m, 2 * nodes, 3))
    R = np.zeros((m, size))  # the samples' gradients in the nodes' bases
    L = np.zeros((8 * points, size))  # the strains' gradients
    CL = np.zeros((8 * points, size))
    K = np.zeros((size, size))
    G = np.zeros((2 * nodes, 2 * nodes))
    for e in range(first, last):
        for a in range(nodes):
            for k in range(3):
                for j in range(2):
                    T[a, k, j] = directors[e, a, k, j] * mitre[e, a]
        # B: gradients of the samples by the mid-surface's y (membrane, then the others)
        for i in range(m):
            near = 0 if i < stretch else nodes  # samples of positions and directors are mixed
            for a in range(nodes):
                v1 = v2 = v3 = 0.0
                for b in range(nodes):
                    form = samples[i, a, near + b]
                    v1 += form * y[e, near + b, 0]
                    v2 += form * y[e, near + b, 1]
                    v3 += form * y[e, near + b, 2]
                B[i, a, 0], B[i, a, 1], B[i, a, 2] = v1, v2, v3
                v1 = v2 = v3 = 0.0
                if near:
                    for b in range(nodes):
                        form = samples[i, b, nodes + a]
                        v1 += form * y[e, b, 0]
                        v2 += form * y[e, b, 1]
                        v3 += form * y[e, b, 2]
                B[i, nodes + a, 0], B[i, nodes + a, 1], B[i, nodes + a, 2] = v1, v2, v3
        # R: the same by the nodes' degrees of freedom, in their bases A and T
        for i in range(m):
            for a in range(nodes):
                h = height[e, a]
                for j in range(3):
                    value = 0.0
                    for k in range(3):
                        value += B[i, a, k] * A[e, a, k, j]
                    R[i, 5 * a + j] = value
                for j in range(2):
                    value = 0.0
                    for k in range(3):
                        value += (B[i, nodes + a, k] + h * B[i, a, k]) * T[a, k, j]
                    R[i, 5 * a + 3 + j] = value
        # L: gradients of the 8 generalized strains at each Gauss point; CL: stiffness times L
        L[:, :] = 0.0
        for g in range(points):
            at = 8 * g
            for c in range(3):
                for i in range(stretch):
                    if membrane[e, g, c, i] != 0.0:
                        for j in range(size):
                            L[at + c, j] += membrane[e, g, c, i] * R[i, j]
                b1, b2, b3 = bending[e, g, c]
                k = stretch + 3 * g
                for j in range(size):
                    L[at + 3 + c, j] = b1 * R[k, j] + b2 * R[k + 1, j] + b3 * R[k + 2, j]
            for c in range(2):
                for i in range(slips):
                    for j in range(size):
                        L[at + 6 + c, j] += shear[e, g, c, i] * R[shears + i, j]
            for c in range(8):
                for i in range(8):
                    C[i] = stiffness[e, g, c, i] * weight[e, g]
                for j in range(size):
                    value = 0.0
                    for i in range(8):
                        value += C[i] * L[at + i, j]
                    CL[at + c, j] = value
        # K: the material part, L^T C L
        np.dot(L.T, CL, K)
        # G: stress times the samples' Hessian, carried from the mid-surface to the nodes' height
        _sample_stress(e, membrane, bending, shear, resultant, stress)
        _geometric(samples, stretch, stress, G)
        for a in range(nodes):
            for b in range(nodes):
                G[a, nodes + b] += height[e, b] * G[a, b]
        for a in range(nodes):
            for b in range(nodes):
                G[nodes + a, nodes + b] = height[e, a] * G[a, nodes + b]
        for a in range(nodes):
            for b in range(nodes):
                G[nodes + a, nodes + b] += height[e, b] * G[nodes + a, b]
        for a in range(nodes):
            for b in range(nodes):
                G[nodes + b, a] = G[a, nodes + b]
        # K += the geometric part, G in the nodes' bases; the lower half alone
        for a in range(nodes):
            for b in range(a + 1):
                for i in range(3):
                    for j in range(3):
                        value = 0.0
                        for k in range(3):
                            value += A[e, a, k, i] * A[e, b, k, j]
                        K[5 * a + i, 5 * b + j] += G[a, b] * value
                    for j in range(2):
                        value = 0.0
                        for k in range(3):
                            value += A[e, a, k, i] * T[b, k, j]
                        K[5 * a + i, 5 * b + 3 + j] += G[a, nodes + b] * value
                for i in range(2):
                    for j in range(3):
                        value = 0.0
                        for k in range(3):
                            value += T[a, k, i] * A[e, b, k, j]
                        K[5 * a + 3 + i, 5 * b + j] += G[nodes + a, b] * value
                    for j in range(2):
                        value = 0.0
                        for k in range(3):
                            value += T[a, k, i] * T[b, k, j]
                        K[5 * a + 3 + i, 5 * b + 3 + j] += G[nodes + a, nodes + b] * value
        # both halves from the lower one
        for i in range(size):
            for j in range(i + 1):
                out[e, i, j] = K[i, j]
                out[e, j, i] = K[i, j]
