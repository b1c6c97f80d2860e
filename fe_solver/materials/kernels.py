"""The sheet's materials at all Gauss points and layers in one pass, compiled by numba where it is
installed: `section.Section.response` of `hyperelastic`, `fibres`, `crossed_fibres` and
`tension_field`, each point by itself, so that any number of threads gives the same bits.

The formulas are those of these modules, whose numpy form the kernel is held to; they derive them,
and serve laws that have no code here.  A potential is a matrix's, a volume's and up to three fibre
families'; `law_table` makes their codes and numbers.  A law's answer at a point is (10,): energy,
S11, S22, S12 and the tangent's 11, 22, 33, 12, 13 and 23.
"""

from __future__ import annotations

import math

import numpy as np

from cosim.port import Array, Ints
from fe_solver.elements import kernels
from fe_solver.elements.kernels import compile_kernel, compile_part, in_parallel

# The columns of the codes, and what stands there.
ACTS, MATRIX, VOLUME, FAMILY, CODES = 0, 1, 2, 3, 6
CONSTANT, LAYERED, RELAXED, ON_MIDDLE = 0, 1, 2, 3
"""`ACTS`: nowhere besides the constant stiffness, at points through the thickness, as a tension
field on the mid-surface, or as it is on the mid-surface."""
AT = (4, 7, 8, 7, 5, 9, 8, 9, 6)
"""Where the entries of the tangent, row by row, stand in a law's answer."""
LINEAR, NEO_HOOKEAN, MOONEY_RIVLIN = 0, 1, 2
INCOMPRESSIBLE, BY_LOGARITHM, BY_SQUARE = 0, 1, 2
"""`VOLUME`: none; k/2 (ln J)^2; k/2 ((J^2 - 1)/2 - ln J)."""
NO_FAMILY, EXPONENTIAL, DISPERSED = 0, 1, 2

# The columns of the numbers.
BULK, BARRIER, RESIDUAL_MODULUS, SMOOTHING, FIBRES, PER_FAMILY, NUMBERS = 6, 7, 8, 9, 10, 10, 40
"""Six of the matrix first: mu; c1 and c2; or the plane stiffness Q11, Q22, Q33, Q12, Q13, Q23.  Of
each family cos^2, sin^2 and sin cos; then c3, c4, c5, lam_max, exp(-c4) Ei(c4) and the
tension and energy at lam_max, or k1, k2 and kappa."""

MOST_FAMILIES = 3
LONGEST = 1.0
"""Longest step in ln J: a factor of e in volume."""
CONVERGED_VOLUME = 1e-12
"""The last step in ln J; those before it double the digits."""
MOST_VOLUME_STEPS = 80
"""Bracketed: bisection alone would reach 1e-12 in some 45."""

LAYERS, LAYER_WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Gauss-Legendre points through the thickness, in [-1, 1]."""

# The search for wrinkles (`wrinkle_search`).
FEW_STEPS, MOST_STEPS = 6, 20
"""From the first guess, and for each height of the barrier."""
CONVERGED, ROUGHLY = 1e-6, 0.1
"""The last step in P, over P, at the barrier's own height and on the way there."""
TURNS = 5
TINY = float(np.finfo(float).tiny)
EPSILON = float(np.finfo(float).eps)
DECADES = 2
"""By which the barrier is lowered at a time."""
CENTRAL = 0.1
"""Strain by which a barrier smooths from which its path begins."""
TO_THE_EDGE = 0.95
"""Share of the step at which P is no longer positive."""
LEAST_SLOPE = 1e-4
HALVINGS = 30
STIFF = 1e-3
"""Share of the tangent's largest entry: the first guess takes no line of the sheet for softer."""
ENERGY_ROUNDING = 1e-2
"""Share of the barrier below which a rise of the energy is a rounding error."""

ASYMPTOTIC = 40.0
"""Where Ei(x) = exp(x)/x sum k!/x^k is exact to the last digit."""
SERIES = np.array([1 / (k * math.factorial(k)) for k in range(1, 121)])
"""The coefficients of Ei(x) = gamma + ln x + sum x^k / (k k!)."""
EULER = 0.5772156649015329


def respond(
    codes: Ints, numbers: Array, sheet: Array, constant: Array, strain: Array
) -> tuple[Array, Array, Array]:
    """Energy (ne, g), force (ne, g, 8) and stiffness (ne, g, 8, 8) at the strain (ne, g, 8): of the
    `constant` stiffness (ne, g, 8, 8) and of the laws of codes (ne, 6) and numbers (ne, g or 1,
    40); sheet (ne, g, 3): thickness, half the shear stiffness (negative where the constant one has
    it), factor of all stresses."""
    energy, force = np.empty(strain.shape[:2]), np.empty(strain.shape)
    stiffness = np.empty((*strain.shape, 8))
    strain = np.ascontiguousarray(strain)

    def work(first: int, last: int) -> None:
        tables = codes, numbers, sheet, constant
        _respond(first, last, *tables, strain, energy, force, stiffness)

    in_parallel(work, len(strain), kernels.PAYS)
    return energy, force, stiffness


@compile_kernel
def _respond(
    first: int,
    last: int,
    codes: Ints,
    numbers: Array,
    sheet: Array,
    constant: Array,
    strain: Array,
    energy: Array,
    force: Array,
    stiffness: Array,
) -> None:
    tables = codes, numbers, sheet, constant
    _respond_at(first, last, *tables, strain, energy, force, stiffness, np.empty(96))


@compile_part
def _respond_at(
    first: int,
    last: int,
    codes: Ints,
    numbers: Array,
    sheet: Array,
    constant: Array,
    strain: Array,
    energy: Array,
    force: Array,
    stiffness: Array,
    work: Array,
) -> None:
    each = numbers.shape[1] > 1
    for e in range(first, last):
        code = codes[e]
        for g in range(strain.shape[1]):
            E, C, F, K = strain[e, g], constant[e, g], force[e, g], stiffness[e, g]
            total = 0.0
            for i in range(8):
                value = 0.0
                for k in range(8):
                    value += C[i, k] * E[k]
                    K[i, k] = C[i, k]
                F[i] = value
                total += 0.5 * value * E[i]
            if code[ACTS] != CONSTANT:
                n = numbers[e, g if each else 0]
                thickness, sheared, factor = sheet[e, g]
                if code[ACTS] == LAYERED:
                    total += _through_thickness(code, n, E, thickness, factor, work, F, K)
                else:
                    total += _on_middle(code, n, E, factor * thickness, work, F, K)
                if sheared >= 0.0:
                    total += _shear(E, factor * sheared, F, K)
            energy[e, g] = total


@compile_part
def _through_thickness(
    code: Ints, n: Array, E: Array, thickness: float, factor: float, work: Array, F: Array, K: Array
) -> float:
    """The energy of a law at points through the thickness; force and stiffness are added."""
    half, law, whole = thickness / 2, work[:10], work[10:20]
    first, second = work[20:30], work[30:40]
    work[10:40] = 0.0
    for layer in range(len(LAYERS)):
        z, w = LAYERS[layer] * half, LAYER_WEIGHTS[layer] * half * factor
        _potential(code, n, E[0] + z * E[3], E[1] + z * E[4], E[2] + z * E[5], law)
        wz = w * z
        wzz = wz * z
        for i in range(10):  # the integral through the thickness and its moments
            whole[i] += w * law[i]
            first[i] += wz * law[i]
            second[i] += wzz * law[i]
    for i in range(3):
        F[i] += whole[1 + i]
        F[3 + i] += first[1 + i]
        for k in range(3):
            at = AT[3 * i + k]
            K[i, k] += whole[at]
            K[i, 3 + k] += first[at]
            K[3 + i, k] += first[at]
            K[3 + i, 3 + k] += second[at]
    return whole[0]


@compile_part
def _on_middle(
    code: Ints, n: Array, E: Array, thickness: float, work: Array, F: Array, K: Array
) -> float:
    """The energy of a law at the mid-surface; force and stiffness are added."""
    law = work[:10]
    if code[ACTS] == RELAXED:
        _relaxed(code, n, E[0], E[1], E[2], law, work[10:])
    else:
        _potential(code, n, E[0], E[1], E[2], law)
    for i in range(3):
        F[i] += thickness * law[1 + i]
        for k in range(3):
            K[i, k] += thickness * law[AT[3 * i + k]]
    return thickness * law[0]


@compile_part
def _shear(E: Array, k: float, F: Array, K: Array) -> float:
    """The energy k (1 / r - 1 / D) of transverse shear (`section._with_shear`); force and stiffness
    are added."""
    c11, c22, c12, g1, g2 = 1 + 2 * E[0], 1 + 2 * E[1], E[2], E[6], E[7]
    D = c11 * c22 - c12 * c12
    r = D - (c22 * g1 * g1 - 2 * c12 * g1 * g2 + c11 * g2 * g2)
    if not (c11 > 0 and D > 0 and r > 0):
        return np.inf
    curved, plain = k / r**2, k / D**2
    by_D = (2 * c22, 2 * c11, -2 * c12, 0.0, 0.0)
    by_r = (
        2 * (c22 - g2 * g2),
        2 * (c11 - g1 * g1),
        -2 * (c12 - g1 * g2),
        -2 * (c22 * g1 - c12 * g2),
        -2 * (c11 * g2 - c12 * g1),
    )
    at = (0, 1, 2, 6, 7)
    for i in range(5):
        F[at[i]] += plain * by_D[i] - curved * by_r[i]
        for j in range(5):
            bent = 2 * curved / r * by_r[i] * by_r[j] - 2 * plain / D * by_D[i] * by_D[j]
            K[at[i], at[j]] += bent
    for i, j, second in (
        (0, 1, 4 * (plain - curved)),
        (0, 7, 4 * curved * g2),
        (1, 6, 4 * curved * g1),
        (2, 6, -2 * curved * g2),
        (2, 7, -2 * curved * g1),
        (6, 7, -2 * curved * c12),
    ):
        K[i, j] += second
        K[j, i] += second
    K[2, 2] += 2 * (curved - plain)
    K[6, 6] += 2 * curved * c22
    K[7, 7] += 2 * curved * c11
    return k / r - k / D


@compile_part
def _law(code: Ints, n: Array, e1: float, e2: float, e3: float, law: Array) -> None:
    """The answer of a linear law or a potential."""
    if code[MATRIX] != LINEAR:
        _potential(code, n, e1, e2, e3, law)
        return
    for i in range(6):
        law[4 + i] = n[i]
    law[1] = n[0] * e1 + n[3] * e2 + n[4] * e3
    law[2] = n[3] * e1 + n[1] * e2 + n[5] * e3
    law[3] = n[4] * e1 + n[5] * e2 + n[2] * e3
    law[0] = (law[1] * e1 + law[2] * e2 + law[3] * e3) / 2


@compile_part
def _potential(code: Ints, n: Array, e1: float, e2: float, e3: float, law: Array) -> None:
    """The answer of a hyperelastic law with ln J condensed, S33 = 0."""
    C11, C22, C12 = 1 + 2 * e1, 1 + 2 * e2, e3
    trace, det = C11 + C22, C11 * C22 - C12 * C12
    j = 0.0
    fine = C11 > 0 and det > 0 and det < np.inf
    if fine and code[VOLUME] != INCOMPRESSIBLE:
        j = _log_volume(code, n, C11, C22, C12)
        fine = j == j
    if fine:
        _expand(code, n, C11, C22, C12, trace, det, j, law)
        total = 0.0
        for i in range(10):
            total += law[i]
        fine = total - total == 0.0  # neither infinite nor NaN
    if not fine:
        law[:10] = 0.0
        law[0] = np.inf


@compile_part
def _log_volume(code: Ints, n: Array, C11: float, C22: float, C12: float) -> float:
    """ln J at which S33 = 0, NaN where none is found (`hyperelastic._log_volume`)."""
    j = 0.0
    if code[MATRIX] == NEO_HOOKEAN:
        j = math.log(C11 * C22 - C12 * C12) / 2
    low, high = -np.inf, np.inf
    for _ in range(MOST_VOLUME_STEPS):
        slope, stiffness = _volumetric(code, n, C11, C22, C12, j)
        if slope < 0:
            low = j
        if slope > 0:
            high = j
        step = min(max(-slope / stiffness, -LONGEST), LONGEST)
        if step != step:
            return np.nan
        near = abs(step) <= CONVERGED_VOLUME
        new = j + step
        if not near and (new <= low or new >= high):
            new = (low + high) / 2
        j = new
        if near:
            return j if abs(j) < np.inf else np.nan
    return np.nan


@compile_part
def _volumetric(
    code: Ints, n: Array, C11: float, C22: float, C12: float, j: float
) -> tuple[float, float]:
    """W_j and W_jj."""
    trace, det, k = C11 + C22, C11 * C22 - C12 * C12, n[BULK]
    a = math.exp(-2 / 3 * j)
    first, first_3 = a * trace, 1 / (a * a * det)  # I1~ of the plane and of C33
    if code[MATRIX] == NEO_HOOKEAN:
        C33 = math.exp(2 * j) / det
        slope, convex = n[0] * (C33 - 1), 2 * n[0] * C33
    else:
        c1, c2 = n[0], n[1]
        second, second_3 = c2 * a * a * det, c2 * trace / (a * det)
        slope = 2 / 3 * (c1 * (2 * first_3 - first) + second_3 - 2 * second)
        convex = 4 / 9 * (c1 * (first + 4 * first_3) + 4 * second + second_3)
    if code[VOLUME] == BY_LOGARITHM:
        slope, convex = slope + k * j, convex + k
    elif code[VOLUME] == BY_SQUARE:
        J2 = math.exp(2 * j)
        slope, convex = slope + k / 2 * (J2 - 1), convex + k * J2
    for family in range(MOST_FAMILIES):
        kind, at = code[FAMILY + family], FIBRES + PER_FAMILY * family
        if kind == NO_FAMILY:
            break
        along = a * (n[at] * C11 + n[at + 1] * C22 + 2 * n[at + 2] * C12)
        if kind == EXPONENTIAL:
            tension, rate = _toe(n, at + 3, math.sqrt(along))
            slope, convex = slope - tension / 3, convex + rate / 9
        else:
            kappa = n[at + 5]
            E = _dispersed_strain(kappa, first, first_3, along)
            by_j, by_jj = _dispersed_by_volume(kappa, first, first_3, along)
            _, W1, W2 = _dispersed(n, at + 3, E)
            slope, convex = slope + W1 * by_j, convex + W1 * by_jj + W2 * by_j**2
    return slope, convex


@compile_part
def _expand(
    code: Ints,
    n: Array,
    C11: float,
    C22: float,
    C12: float,
    trace: float,
    det: float,
    j: float,
    law: Array,
) -> None:
    """The answer at ln J = j: W_p of the invariants p = (trace, det, fibres) times their gradients
    dp, and W_pq dp dq - m m / W_jj with the mixed m = W_pj dp."""
    free, a, b, by_D = code[VOLUME] != INCOMPRESSIBLE, 1.0, 1.0, 1 / det
    if free:
        a = math.exp(-2 / 3 * j)
        b = 1 / (a * a)
    d1, d2, d3 = 2 * C22, 2 * C11, -2 * C12  # det's gradient; the trace's is (2, 2, 0)
    # the matrix: slopes by trace and det, curvatures, mixed derivatives
    if code[MATRIX] == NEO_HOOKEAN:
        C33 = math.exp(2 * j) / det
        by_trace, by_det = n[0] / 2, -n[0] * C33 / (2 * det)
        across, bent = 0.0, -2 * by_det / det
        trace_j, det_j = 0.0, 2 * by_det
        energy, W_jj = n[0] / 2 * (trace + C33 - 3) - n[0] * j, 2 * n[0] * C33
    else:
        c1, c2 = n[0], n[1]
        c1b, c2a, c2i = c1 * b * by_D * by_D, c2 * by_D / a, c2 * a * a
        second_3 = c2a * trace * by_D
        by_trace, by_det = c1 * a + c2a, c2i - c1b - second_3
        across, bent = -c2a * by_D, 2 * (c1b + second_3) * by_D
        trace_j = 2 / 3 * (c2a - c1 * a)
        det_j = -2 / 3 * (2 * c1b + 2 * c2i + second_3)
        energy = c1 * (a * trace + b * by_D - 3) + c2 * (a * a * det - 3) + c2a * trace
        W_jj = 4 / 9 * (c1 * (a * trace + 4 * b * by_D) + 4 * c2i * det + c2a * trace)
    if code[VOLUME] == BY_LOGARITHM:
        energy, W_jj = energy + n[BULK] / 2 * j * j, W_jj + n[BULK]
    elif code[VOLUME] == BY_SQUARE:
        energy += n[BULK] / 2 * (math.expm1(2 * j) / 2 - j)
        W_jj += n[BULK] * math.exp(2 * j)
    S1, S2, S3 = 2 * by_trace + by_det * d1, 2 * by_trace + by_det * d2, by_det * d3
    m1, m2, m3 = 2 * trace_j + det_j * d1, 2 * trace_j + det_j * d2, det_j * d3
    T11 = bent * d1 * d1 + 4 * across * d1
    T22 = bent * d2 * d2 + 4 * across * d2
    T12 = bent * d1 * d2 + 2 * across * (d1 + d2)
    T13, T23 = (bent * d1 + 2 * across) * d3, (bent * d2 + 2 * across) * d3
    T33 = bent * d3 * d3
    # the fibre families
    for family in range(MOST_FAMILIES):
        kind, at = code[FAMILY + family], FIBRES + PER_FAMILY * family
        if kind == NO_FAMILY:
            break
        cc, ss, sc = n[at], n[at + 1], n[at + 2]
        f = cc * C11 + ss * C22 + 2 * sc * C12
        if kind == EXPONENTIAL:
            stretch = math.sqrt(a * f)
            if stretch < 1.0:  # slack
                continue
            tension, rate = _toe(n, at + 3, stretch)
            energy += _toe_energy(n, at + 3, stretch, tension)
            by_f = 0.5 / f
            W1, W2, W1_j = tension * by_f, (rate - 2 * tension) * by_f * by_f, -rate * by_f / 3
            b1, b2, b3 = 2 * cc, 2 * ss, 2 * sc
            m1, m2, m3 = m1 + W1_j * b1, m2 + W1_j * b2, m3 + W1_j * b3
            W_jj += rate / 9
        else:
            kappa, straight = n[at + 5], 1 - 3 * n[at + 5]
            first, first_3, along = a * trace, b / det, a * f
            W, W1, W2 = _dispersed(n, at + 3, _dispersed_strain(kappa, first, first_3, along))
            by_j, by_jj = _dispersed_by_volume(kappa, first, first_3, along)
            energy += W
            E_det = -kappa * b / det**2
            b1 = 2 * kappa * a + E_det * d1 + straight * a * 2 * cc
            b2 = 2 * kappa * a + E_det * d2 + straight * a * 2 * ss
            b3 = E_det * d3 + straight * a * 2 * sc
            # E's derivatives by j: -2/3 of what goes with a, 4/3 of what goes with b
            m1 += W2 * by_j * b1 + W1 * (-2 / 3 * b1 + 2 * E_det * d1)
            m2 += W2 * by_j * b2 + W1 * (-2 / 3 * b2 + 2 * E_det * d2)
            m3 += W2 * by_j * b3 + W1 * (-2 / 3 * b3 + 2 * E_det * d3)
            W_jj += W1 * by_jj + W2 * by_j**2
            c = -2 * W1 * E_det / det
            T11, T22, T33 = T11 + c * d1 * d1, T22 + c * d2 * d2, T33 + c * d3 * d3
            T12, T13, T23 = T12 + c * d1 * d2, T13 + c * d1 * d3, T23 + c * d2 * d3
            by_det += W1 * E_det
        S1, S2, S3 = S1 + W1 * b1, S2 + W1 * b2, S3 + W1 * b3
        T11, T22, T33 = T11 + W2 * b1 * b1, T22 + W2 * b2 * b2, T33 + W2 * b3 * b3
        T12, T13, T23 = T12 + W2 * b1 * b2, T13 + W2 * b1 * b3, T23 + W2 * b2 * b3
    # det's own curvature, and the condensation of ln J
    T12 += 4 * by_det
    T33 -= 2 * by_det
    if free:
        T11, T22, T33 = T11 - m1 * (m1 / W_jj), T22 - m2 * (m2 / W_jj), T33 - m3 * (m3 / W_jj)
        T12, T13, T23 = T12 - m1 * (m2 / W_jj), T13 - m1 * (m3 / W_jj), T23 - m2 * (m3 / W_jj)
    law[0], law[1], law[2], law[3] = energy, S1, S2, S3
    law[4], law[5], law[6], law[7], law[8], law[9] = T11, T22, T33, T12, T13, T23


@compile_part
def _toe(n: Array, at: int, stretch: float) -> tuple[float, float]:
    """l dF/dl and l times its derivative by l (`ExponentialToe.tension`)."""
    c3, c4, c5, lam_max = n[at], n[at + 1], n[at + 2], n[at + 3]
    if stretch < 1.0:
        return 0.0, 0.0
    if stretch >= lam_max:
        return n[at + 5] + c5 * (stretch - lam_max), c5 * stretch
    x = c3 * math.exp(c4 * (stretch - 1))
    return x - c3, c4 * x * stretch


@compile_part
def _toe_energy(n: Array, at: int, stretch: float, tension: float) -> float:
    """F (`ExponentialToe.fibre_energy`) of a fibre that is not slack."""
    c3, c4, c5, lam_max, at_rest = n[at], n[at + 1], n[at + 2], n[at + 3], n[at + 4]
    if stretch < lam_max:
        return (tension + c3) * _scaled_expi(c4 * stretch) - c3 * (at_rest + math.log(stretch))
    c6, ratio = n[at + 5] - c5 * lam_max, stretch / lam_max  # of both terms, or it does not cancel
    return n[at + 6] + c5 * lam_max * (ratio - 1) + c6 * math.log(ratio)


@compile_part
def _scaled_expi(x: float) -> float:
    """The exponential integral Ei(x) of x > 0, times exp(-x)."""
    total = 0.0
    if x < ASYMPTOTIC:
        for k in range(min(len(SERIES), 22 + int(2.4 * x)) - 1, -1, -1):
            total = total * x + SERIES[k]
        return math.exp(-x) * (EULER + math.log(x) + total * x)
    term = 1 / x
    by_x = term
    for k in range(1, 40):
        total += term
        term *= k * by_x
        if term < 1e-17 * total:
            break
    return total


@compile_part
def _dispersed_strain(kappa: float, first: float, first_3: float, along: float) -> float:
    """E of plane and thickness parts of I1~, and of I4~ (`DispersedFamily._strain`)."""
    return kappa * (first + first_3 - 3) + (1 - 3 * kappa) * along - (1 - 3 * kappa)


@compile_part
def _dispersed_by_volume(
    kappa: float, first: float, first_3: float, along: float
) -> tuple[float, float]:
    """E's first and second derivative by ln J."""
    straight = (1 - 3 * kappa) * along
    by_j = kappa * 2 / 3 * (2 * first_3 - first) - 2 / 3 * straight
    return by_j, kappa * 4 / 9 * (first + 4 * first_3) + 4 / 9 * straight


@compile_part
def _dispersed(n: Array, at: int, E: float) -> tuple[float, float, float]:
    """W and its first and second derivative by E (`DispersedFamily._by_strain`)."""
    k1, k2 = n[at], n[at + 1]
    if E < 0.0:
        return 0.0, 0.0, 0.0
    power = k2 * E * E
    x = k1 * math.exp(power)
    return k1 * math.expm1(power) / (2 * k2), x * E, x * (1 + 2 * power)


@compile_part
def _relaxed(
    code: Ints, n: Array, e1: float, e2: float, e3: float, out: Array, work: Array
) -> None:
    """The answer `out` (10,) of a tension field (`tension_field.TensionField.response`)."""
    law, T, K, M, A = work[:10], work[10:19], work[19:28], work[28:37], work[37:41]
    solved = _find_wrinkles(code, n, e1, e2, e3, A, law, work[41:])
    mu, residual = n[BARRIER], n[RESIDUAL_MODULUS]
    energy = law[0] + _wrinkle_cost(A, mu, residual) + 2 * mu * math.log(n[SMOOTHING])
    if not (solved and energy < np.inf):
        out[:10] = 0.0
        out[0] = np.inf
        return
    # S = dW/dE at E + P, and its tangent with the wrinkles' growth condensed
    _by_growth(A, T)
    _growth_curvature(T, law, mu, residual, K)
    for i in range(3):
        for k in range(3):
            M[3 * i + k] = 0.0
            for m in range(3):
                M[3 * i + k] += T[3 * m + i] * law[AT[3 * m + k]]
    for i in range(9):
        T[i] = M[i]
    _solve_symmetric(K, M, 3)
    out[0] = energy
    for i in range(3):
        out[1 + i] = law[1 + i]
        for k in range(i, 3):
            c = law[AT[3 * i + k]]
            for m in range(3):
                c -= 0.5 * (T[3 * m + i] * M[3 * m + k] + T[3 * m + k] * M[3 * m + i])
            out[AT[3 * i + k]] = c


@compile_part
def _find_wrinkles(
    code: Ints, n: Array, e1: float, e2: float, e3: float, A: Array, law: Array, work: Array
) -> bool:
    """Whether the balance was found: the wrinkles A (4,), row by row, and the base `law` there
    (`wrinkle_search.find_wrinkles`)."""
    mu, residual, smoothing = n[BARRIER], n[RESIDUAL_MODULUS], n[SMOOTHING]
    sound = e1 - e1 == 0.0 and e2 - e2 == 0.0 and e3 - e3 == 0.0
    if not sound:
        return False
    _law(code, n, e1, e2, e3, law)
    if law[0] < np.inf:
        _axes_guess(law, mu, A)
        if _descend(code, n, e1, e2, e3, mu, residual, FEW_STEPS, CONVERGED, A, law, work):
            return True
        _law(code, n, e1, e2, e3, law)
        _turning_guess(code, n, e1, e2, e3, mu, A, law)
        if _descend(code, n, e1, e2, e3, mu, residual, FEW_STEPS, CONVERGED, A, law, work):
            return True
    _central_guess(e1, e2, e3, A)
    top = 2 * math.log10(CENTRAL / smoothing)
    decades = max(math.ceil(top / DECADES), 0)
    for i in range(decades):
        height = mu * 10.0 ** (top - DECADES * i)
        _descend(code, n, e1, e2, e3, height, residual, MOST_STEPS, ROUGHLY, A, law, work)
    return _descend(code, n, e1, e2, e3, mu, residual, MOST_STEPS, CONVERGED, A, law, work)


@compile_part
def _descend(
    code: Ints,
    n: Array,
    e1: float,
    e2: float,
    e3: float,
    mu: float,
    residual: float,
    steps: int,
    converged: float,
    A: Array,
    law: Array,
    work: Array,
) -> bool:
    """Whether Newton's iteration in the growth arrives: A and the law there, changed in place."""
    T, K, slope, X, grown = work[:9], work[9:18], work[18:21], work[21:24], work[24:28]
    _law_with_wrinkles(code, n, e1, e2, e3, A, law)
    for _ in range(steps):
        level = law[0] + _wrinkle_cost(A, mu, residual)
        _by_growth(A, T)
        P1, P2, P3 = _wrinkle_strain(A)
        for i in range(3):
            slope[i] = -mu if i < 2 else 0.0
            slope[i] += T[i] * (law[1] + residual * P1)
            slope[i] += T[3 + i] * (law[2] + residual * P2)
            slope[i] += T[6 + i] * (law[3] + residual * 0.5 * P3)
            X[i] = -slope[i]
        _growth_curvature(T, law, mu, residual, K)
        _solve_symmetric(K, X, 1)
        along = slope[0] * X[0] + slope[1] * X[1] + slope[2] * X[2]
        if not along < 0:
            for i in range(3):
                X[i] = -slope[i] / mu
            along = slope[0] * X[0] + slope[1] * X[1] + slope[2] * X[2]
        near = math.sqrt(X[0] ** 2 + X[1] ** 2 + 2 * X[2] ** 2) <= converged
        least = (X[0] + X[1]) / 2 - math.hypot((X[0] - X[1]) / 2, X[2])
        size = 1 / max(1.0, -least / TO_THE_EDGE)
        noise = ENERGY_ROUNDING * (mu + abs(level) * 1e-13)
        for _halving in range(HALVINGS):
            # L L' = 1 + size X, and A grown to A L
            L11 = math.sqrt(1 + size * X[0])
            L21 = size * X[2] / L11
            L22 = math.sqrt(1 + size * X[1] - L21 * L21)
            grown[0], grown[1] = A[0] * L11 + A[1] * L21, A[1] * L22
            grown[2], grown[3] = A[2] * L11 + A[3] * L21, A[3] * L22
            _law_with_wrinkles(code, n, e1, e2, e3, grown, law)
            rise = law[0] + _wrinkle_cost(grown, mu, residual) - level
            if near or rise <= LEAST_SLOPE * size * along + noise:
                break
            size /= 2
        for i in range(4):
            A[i] = grown[i]
        if near:
            return True
    return False


@compile_part
def _law_with_wrinkles(
    code: Ints, n: Array, e1: float, e2: float, e3: float, A: Array, law: Array
) -> None:
    """The answer of the base law at E + P."""
    P1, P2, P3 = _wrinkle_strain(A)
    _law(code, n, e1 + P1, e2 + P2, e3 + P3, law)


@compile_part
def _wrinkle_strain(A: Array) -> tuple[float, float, float]:
    """P = A A' as E11, E22, 2 E12."""
    a, b, c, d = A[0], A[1], A[2], A[3]
    return a * a + b * b, c * c + d * d, 2 * (a * c + b * d)


@compile_part
def _wrinkle_cost(A: Array, mu: float, residual: float) -> float:
    """What wrinkles cost: - mu log det P + residual P:P / 2."""
    P1, P2, P3 = _wrinkle_strain(A)
    area = abs(A[0] * A[3] - A[1] * A[2])
    return residual / 2 * (P1 * P1 + P2 * P2 + P3 * P3 / 2) - 2 * mu * math.log(area)


@compile_part
def _by_growth(A: Array, T: Array) -> None:
    """The derivatives T (9,) of P by X11, X22, X12 where P grows to A (1 + X) A'."""
    a, b, c, d = A[0], A[1], A[2], A[3]
    T[0], T[1], T[2] = a * a, b * b, 2 * a * b
    T[3], T[4], T[5] = c * c, d * d, 2 * c * d
    T[6], T[7], T[8] = 2 * a * c, 2 * b * d, 2 * (a * d + b * c)


@compile_part
def _growth_curvature(T: Array, law: Array, mu: float, residual: float, K: Array) -> None:
    """The second derivatives K (9,) of energy and cost by the growth."""
    for i in range(3):
        for k in range(i + 1):
            value = 0.0
            for m in range(3):
                for p in range(3):
                    stiff = law[AT[3 * m + p]]
                    if m == p:
                        stiff += residual * (1.0 if m < 2 else 0.5)
                    value += T[3 * m + i] * stiff * T[3 * p + k]
            K[3 * i + k] = K[3 * k + i] = value
        K[4 * i] += mu if i < 2 else 2 * mu


@compile_part
def _solve_symmetric(K: Array, R: Array, columns: int) -> None:
    """Put into R (3 * columns,) the solutions of K (9,), of the like of a singular one too."""
    s1, s2, s3 = 1 / math.sqrt(K[0]), 1 / math.sqrt(K[4]), 1 / math.sqrt(K[8])
    scale = (s1, s2, s3)
    for i in range(3):
        for k in range(3):
            K[3 * i + k] *= scale[i] * scale[k]
        K[4 * i] += EPSILON
        for k in range(columns):
            R[columns * i + k] *= scale[i]
    for i in range(3):
        pivot = i
        for k in range(i + 1, 3):
            if abs(K[3 * k + i]) > abs(K[3 * pivot + i]):
                pivot = k
        if pivot != i:
            for k in range(3):
                K[3 * i + k], K[3 * pivot + k] = K[3 * pivot + k], K[3 * i + k]
            for k in range(columns):
                a, b = columns * i + k, columns * pivot + k
                R[a], R[b] = R[b], R[a]
        for k in range(i + 1, 3):
            by = K[3 * k + i] / K[4 * i]
            for m in range(i, 3):
                K[3 * k + m] -= by * K[3 * i + m]
            for m in range(columns):
                R[columns * k + m] -= by * R[columns * i + m]
    for i in range(2, -1, -1):
        for k in range(columns):
            value = R[columns * i + k]
            for m in range(i + 1, 3):
                value -= K[3 * i + m] * R[columns * m + k]
            R[columns * i + k] = value / K[4 * i]
    for i in range(3):
        for k in range(columns):
            R[columns * i + k] *= scale[i]


@compile_part
def _principal(x1: float, x2: float, x12: float) -> tuple[float, float, float, float]:
    """The principal values of a tensor, the greater first, and cosine and sine of its axis."""
    mean, half = (x1 + x2) / 2, (x1 - x2) / 2
    radius, angle = math.hypot(half, x12), math.atan2(x12, half) / 2
    return mean + radius, mean - radius, math.cos(angle), math.sin(angle)


@compile_part
def _strain_in_balance(stress: float, stiff: float, mu: float) -> float:
    """The p > 0 of stress + stiff p = mu / p."""
    root = math.sqrt(stress * stress + 4 * stiff * mu)
    return 2 * mu / (root + stress) if stress > 0 else (root - stress) / (2 * stiff)


@compile_part
def _along(law: Array, u1: float, u2: float, u3: float, v1: float, v2: float, v3: float) -> float:
    """The tangent's u . C . v."""
    value = u1 * (law[4] * v1 + law[7] * v2 + law[8] * v3)
    value += u2 * (law[7] * v1 + law[5] * v2 + law[9] * v3)
    return value + u3 * (law[8] * v1 + law[9] * v2 + law[6] * v3)


@compile_part
def _least_stiffness(law: Array) -> float:
    """STIFF of the tangent's largest entry."""
    largest = 0.0
    for i in range(4, 10):
        largest = max(largest, abs(law[i]))
    return STIFF * largest


@compile_part
def _axes_guess(law: Array, mu: float, A: Array) -> None:
    """The guess where first the lesser and then the greater principal stress is in balance."""
    high, low, c, s = _principal(law[1], law[2], law[3])
    cc, ss, sc = c * c, s * s, c * s
    least = _least_stiffness(law)
    stiff = _along(law, ss, cc, -2 * sc, ss, cc, -2 * sc)
    lesser = _strain_in_balance(low, max(stiff, least), mu)
    high += lesser * _along(law, cc, ss, 2 * sc, ss, cc, -2 * sc)
    stiff = _along(law, cc, ss, 2 * sc, cc, ss, 2 * sc)
    greater = math.sqrt(_strain_in_balance(high, max(stiff, least), mu))
    lesser = math.sqrt(lesser)
    A[0], A[1], A[2], A[3] = c * greater, -s * lesser, s * greater, c * lesser


@compile_part
def _central_guess(e1: float, e2: float, e3: float, A: Array) -> None:
    """The guess that makes up for every shortening, and for CENTRAL more."""
    high, low, c, s = _principal(e1, e2, e3 / 2)
    high, low = math.sqrt(max(-high, 0.0) + CENTRAL), math.sqrt(max(-low, 0.0) + CENTRAL)
    A[0], A[1], A[2], A[3] = c * high, -s * low, s * high, c * low


@compile_part
def _turning_guess(
    code: Ints, n: Array, e1: float, e2: float, e3: float, mu: float, A: Array, law: Array
) -> None:
    """The guess (p, t) with p of the least W(E + p p') by TURNS Newton steps from the axis of the
    lesser principal stress, and t across it in balance."""
    _axes_guess(law, mu, A)
    p1, p2 = A[1], A[3]
    for turn in range(TURNS + 1):
        _law(code, n, e1 + p1 * p1, e2 + p2 * p2, e3 + 2 * p1 * p2, law)
        if turn == TURNS:
            break
        S1, S2, S3 = law[1], law[2], law[3]
        slope1, slope2 = 2 * (p1 * S1 + p2 * S3), 2 * (p2 * S2 + p1 * S3)
        b1, b2 = 2 * p1, 2 * p2
        H11 = _along(law, b1, 0.0, b2, b1, 0.0, b2) + 2 * S1
        H22 = _along(law, 0.0, b2, b1, 0.0, b2, b1) + 2 * S2
        H12 = _along(law, b1, 0.0, b2, 0.0, b2, b1) + 2 * S3
        high, low, c, s = _principal(H11, H22, H12)
        u = -(c * slope1 + s * slope2) / max(abs(high), TINY)
        v = -(c * slope2 - s * slope1) / max(abs(low), TINY)
        share = min(1.0, math.hypot(p1, p2) / max(math.hypot(u, v), TINY))
        p1, p2 = p1 + share * (c * u - s * v), p2 + share * (s * u + c * v)
    size = max(math.hypot(p1, p2), TINY)
    t1, t2 = -p2 / size, p1 / size
    u1, u2, u3 = t1 * t1, t2 * t2, 2 * t1 * t2
    stiff = max(_along(law, u1, u2, u3, u1, u2, u3), _least_stiffness(law))
    across = _strain_in_balance(u1 * law[1] + u2 * law[2] + u3 * law[3], stiff, mu)
    across = math.sqrt(across)
    A[0], A[1], A[2], A[3] = p1, across * t1, p2, across * t2
