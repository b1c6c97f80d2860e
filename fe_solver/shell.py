"""Four-node shell element: total Lagrangian, finite rotations, position and unit director.

The shell is x(r, s) + z d(r, s), with z the distance from the mid-surface along the director.  With
y = (x1..x4, d1..d4) every covariant strain is a quadratic form of y,

    membrane   e_ab = (x,a . x,b - X,a . X,b) / 2
    bending    k_ab = (x,a . d,b + x,b . d,a - reference) / 2
    shear      g_a  =  x,a . d - reference

so that its gradient is linear in y, its Hessian is constant and the tangent is exact and symmetric.
Transverse shear is tied at the edge midpoints (MITC4: Dvorkin and Bathe 1984, Eng Comput 1:77); the
membrane strains are tied at the edge midpoints and the centre (MITC4+: Ko, Lee and Bathe 2017,
Comput Struct 182:404), which leaves a flat element as it is and cures the membrane locking of a
warped one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GAUSS = CORNERS / np.sqrt(3.0)
SHEAR_CORRECTION = 5.0 / 6.0


def shape(r: float, s: float) -> tuple[Array, Array, Array]:
    """Bilinear shape functions and their derivatives by r and by s, each (4,)."""
    a, b = 1 + CORNERS[:, 0] * r, 1 + CORNERS[:, 1] * s
    return a * b / 4, CORNERS[:, 0] * b / 4, CORNERS[:, 1] * a / 4


def _xx(a: Array, b: Array) -> Array:
    """(8, 8) M with y.M.y / 2 = (x,a . x,b), of the positions' half of y."""
    out = np.zeros((8, 8))
    out[:4, :4] = np.outer(a, b) + np.outer(b, a)
    return out


def _xd(a: Array, b: Array) -> Array:
    """(8, 8) M with y.M.y / 2 = (sum a x) . (sum b d)."""
    out = np.zeros((8, 8))
    out[:4, 4:] = np.outer(a, b)
    out[4:, :4] = np.outer(b, a)
    return out


def _membrane(r: float, s: float) -> Array:
    """(3, 8, 8) forms of e_rr, e_ss, e_rs (tensor components) at one point."""
    _, nr, ns = shape(r, s)
    return np.stack([_xx(nr, nr) / 2, _xx(ns, ns) / 2, _xx(nr, ns) / 2])


def _bending(r: float, s: float) -> Array:
    """(3, 8, 8) forms of k_rr, k_ss, k_rs at one point."""
    _, nr, ns = shape(r, s)
    return np.stack([_xd(nr, nr), _xd(ns, ns), (_xd(nr, ns) + _xd(ns, nr)) / 2])


def _shear(r: float, s: float) -> Array:
    """(2, 8, 8) forms of g_r, g_s tied at the edge midpoints (MITC4)."""

    def g_r(r: float, s: float) -> Array:
        n, nr, _ = shape(r, s)
        return _xd(nr, n)

    def g_s(r: float, s: float) -> Array:
        n, _, ns = shape(r, s)
        return _xd(ns, n)

    return np.stack(
        [
            ((1 - s) * g_r(0, -1) + (1 + s) * g_r(0, 1)) / 2,
            ((1 - r) * g_s(-1, 0) + (1 + r) * g_s(1, 0)) / 2,
        ]
    )


def _distortion(X: Array) -> Array:
    """(ne, 5) coefficients a_A..a_E of the MITC4+ membrane field; X (ne, 4, 3).

    Ko, Lee and Bathe 2017, equations 15 to 18: the components of the element's hourglass vector
    along the dual base vectors of its centre."""
    xr, xs, xd = (np.einsum("a,nak->nk", c, X) / 4 for c in _HOURGLASS)
    normal = np.cross(xr, xs)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    dual_r, dual_s = np.cross(xs, normal), np.cross(normal, xr)
    cr = np.einsum("nk,nk->n", dual_r, xd) / np.einsum("nk,nk->n", dual_r, xr)
    cs = np.einsum("nk,nk->n", dual_s, xd) / np.einsum("nk,nk->n", dual_s, xs)
    d = cr**2 + cs**2 - 1
    return (
        np.stack(
            [
                cr * (cr - 1) / 2,
                cr * (cr + 1) / 2,
                cs * (cs - 1) / 2,
                cs * (cs + 1) / 2,
                2 * cr * cs,
            ],
            1,
        )
        / d[:, None]
    )


_HOURGLASS = (CORNERS[:, 0], CORNERS[:, 1], CORNERS[:, 0] * CORNERS[:, 1])


def _tied_membrane(a: Array, r: float, s: float) -> Array:
    """(ne, 3, 8, 8) MITC4+ forms of e_rr, e_ss, e_rs at one point; a (ne, 5)."""
    A, B = _membrane(0, 1)[0], _membrane(0, -1)[0]
    C, D = _membrane(1, 0)[1], _membrane(-1, 0)[1]
    E = _membrane(0, 0)[2]
    aA, aB, aC, aD, aE = (c[:, None, None] for c in a.T)
    p, q = r * r - 1, s * s - 1
    rr = (
        (0.5 * (1 - 2 * aA + s + 2 * aA * s * s)) * A
        + (0.5 * (1 - 2 * aB - s + 2 * aB * s * s)) * B
        + aC * q * C
        + aD * q * D
        + aE * q * E
    )
    ss = (
        aA * p * A
        + aB * p * B
        + (0.5 * (1 - 2 * aC + r + 2 * aC * r * r)) * C
        + (0.5 * (1 - 2 * aD - r + 2 * aD * r * r)) * D
        + aE * p * E
    )
    rs = (
        0.25 * (r + 4 * aA * r * s) * A
        + 0.25 * (-r + 4 * aB * r * s) * B
        + 0.25 * (s + 4 * aC * r * s) * C
        + 0.25 * (-s + 4 * aD * r * s) * D
        + (1 + aE * r * s) * E
    )
    return np.stack([rr, ss, rs], axis=1)


def _to_cartesian(J: Array, tensor: Array) -> Array:
    """Covariant forms (rr, ss, rs) to local Cartesian (11, 22, 2 x 12): J (ne, 2, 2) holds the
    covariant base vectors' local components, columns r and s; tensor (ne, 3, ...)."""
    P = np.linalg.inv(J)
    a, b, c, d = P[:, 0, 0], P[:, 0, 1], P[:, 1, 0], P[:, 1, 1]
    T = np.stack(
        [
            np.stack([a * a, c * c, 2 * a * c], 1),
            np.stack([b * b, d * d, 2 * b * d], 1),
            np.stack([2 * a * b, 2 * c * d, 2 * (a * d + b * c)], 1),
        ],
        1,
    )
    return np.einsum("nij,njab->niab", T, tensor)


@dataclass(frozen=True)
class ShellTables:
    """Constant tables of a mesh of shell elements.

    forms (ne, 32, 8, 8): strain c of Gauss point g at row 8 g + c is y.forms.y / 2 - offset;
    offset (ne, 32); weight (ne, 4) reference area of each Gauss point; frame (ne, 4, 3, 3) rows
    local axes 1 (fibre), 2 (transverse), 3 (normal) in the reference configuration."""

    forms: Array
    offset: Array
    weight: Array
    frame: Array

    def strain(self, y: Array) -> Array:
        """(ne, 4, 8) generalized strains of y (ne, 8, 3): e11, e22, 2 e12 of the mid-surface, k11,
        k22, 2 k12 of bending, g13, g23 of transverse shear."""
        value = np.einsum("ncak,nak->nc", self.forms @ y[:, None], y) / 2 - self.offset
        return value.reshape(-1, 4, 8)


def local_frames(X: Array, fibre: Array, r: float, s: float) -> tuple[Array, Array, Array]:
    """Local axes (ne, 3, 3) as rows, J (ne, 2, 2) and area factor (ne,) at one point of the
    reference elements X (ne, 4, 3); axis 1 is `fibre` (ne, 3) brought into the tangent plane."""
    _, nr, ns = shape(r, s)
    G = np.stack([np.einsum("a,nak->nk", nr, X), np.einsum("a,nak->nk", ns, X)], axis=1)
    normal = np.cross(G[:, 0], G[:, 1])
    area = np.linalg.norm(normal, axis=1)
    normal = normal / area[:, None]
    e1 = fibre - np.einsum("nk,nk->n", fibre, normal)[:, None] * normal
    e1 = e1 / np.linalg.norm(e1, axis=1, keepdims=True)
    frame = np.stack([e1, np.cross(normal, e1), normal], axis=1)
    return frame, np.einsum("nik,ngk->nig", frame[:, :2], G), area


def shell_tables(X: Array, D: Array, fibre: Array, growth: Array) -> ShellTables:
    """Tables for elements with reference positions X (ne, 4, 3), unit directors D (ne, 4, 3), fibre
    directions (ne, 3) and fibre growth (ne,): the stress-free length along the fibre is 1 + growth
    times that of the mesh (a multiplicative, plane eigenstrain)."""
    distortion = _distortion(X)
    Y = np.concatenate([X, D], axis=1)
    stretch = np.ones((len(X), 3))
    stretch[:, 0], stretch[:, 2] = (1 + growth) ** -2, 1 / (1 + growth)
    forms, offset, weight, frames = [], [], [], []
    for r, s in GAUSS:
        frame, J, area = local_frames(X, fibre, r, s)
        membrane = _to_cartesian(J, _tied_membrane(distortion, r, s))
        bending = _to_cartesian(J, np.broadcast_to(_bending(r, s), (len(X), 3, 8, 8)))
        shear = np.einsum("nab,bij->naij", np.swapaxes(np.linalg.inv(J), 1, 2), _shear(r, s))
        grown = np.ones((len(X), 8))
        grown[:, :3] = grown[:, 3:6] = stretch
        grown[:, 6] = stretch[:, 2]
        q = np.concatenate([membrane, bending, shear], axis=1) * grown[:, :, None, None]
        c = np.einsum("ncab,nak,nbk->nc", q, Y, Y, optimize=True) / 2
        c[:, 0] += (1 - stretch[:, 0]) / 2
        forms.append(q)
        offset.append(c)
        weight.append(area * (1 + growth))
        frames.append(frame)
    return ShellTables(
        np.concatenate(forms, axis=1),
        np.concatenate(offset, axis=1),
        np.stack(weight, axis=1),
        np.stack(frames, axis=1),
    )


def isotropic_stiffness(modulus: Array, poisson: Array, thickness: Array) -> Array:
    """(ne, 8, 8) stiffness of the stress resultants against the generalized strains: Saint
    Venant-Kirchhoff in plane stress, moduli in Pa, thickness in m, all (ne,)."""
    modulus, poisson, thickness = np.broadcast_arrays(modulus, poisson, thickness)
    plane = np.zeros((len(modulus), 3, 3))
    plane[:, 0, 0] = plane[:, 1, 1] = 1.0
    plane[:, 0, 1] = plane[:, 1, 0] = poisson
    plane[:, 2, 2] = (1 - poisson) / 2
    plane *= (modulus / (1 - poisson**2))[:, None, None]
    out = np.zeros((len(modulus), 8, 8))
    out[:, :3, :3] = plane * thickness[:, None, None]
    out[:, 3:6, 3:6] = plane * (thickness**3 / 12)[:, None, None]
    shear = SHEAR_CORRECTION * modulus / (2 * (1 + poisson)) * thickness
    out[:, 6, 6] = out[:, 7, 7] = shear
    return out


@dataclass(frozen=True)
class ElementResponse:
    """Energy (J), its gradient (ne, 8, 3) and, on request, its Hessian (ne, 24, 24) by y."""

    energy: float
    gradient: Array
    hessian: Array | None


def tensile(resultant: Array) -> Array:
    """The part of the stress resultants (ne, 4, 8) whose geometric stiffness is not negative: the
    membrane's tensile principal forces."""
    n1, n2, n12 = resultant[..., 0], resultant[..., 1], resultant[..., 2]
    mean, half = (n1 + n2) / 2, (n1 - n2) / 2
    radius = np.hypot(half, n12)
    high, low = np.maximum(mean + radius, 0), np.maximum(mean - radius, 0)
    ratio = np.divide(high - low, 2 * radius, out=np.zeros_like(radius), where=radius > 0)
    out = np.zeros_like(resultant)
    out[..., 0] = (high + low) / 2 + ratio * half
    out[..., 1] = (high + low) / 2 - ratio * half
    out[..., 2] = ratio * n12
    return out


def element_response(
    tables: ShellTables, stiffness: Array, y: Array, tangent: bool, convex: bool = False
) -> ElementResponse:
    """Energy, gradient and Hessian of all elements at y (ne, 8, 3); stiffness (ne, 8, 8).

    `convex` keeps of the geometric stiffness what tension makes, so that the Hessian is positive
    semidefinite: not consistent, but a descent direction from any state."""
    ne = len(y)
    B = tables.forms @ y[:, None]  # (ne, 32, 8, 3)
    strain = np.einsum("ncak,nak->nc", B, y) / 2 - tables.offset
    resultant = strain.reshape(ne, 4, 8) @ stiffness * tables.weight[:, :, None]
    energy = 0.5 * float(np.vdot(resultant, strain))
    flat = B.reshape(ne, 32, 24)
    stress = resultant.reshape(ne, 1, 32)
    gradient = (stress @ flat).reshape(ne, 8, 3)
    if not tangent:
        return ElementResponse(energy, gradient, None)
    weighted = stiffness[:, None] @ B.reshape(ne, 4, 8, 24) * tables.weight[:, :, None, None]
    hessian = np.swapaxes(flat, 1, 2) @ weighted.reshape(ne, 32, 24)
    if convex:
        stress = tensile(resultant.reshape(ne, 4, 8)).reshape(ne, 1, 32)
    geometric = (stress @ tables.forms.reshape(ne, 32, 64)).reshape(ne, 8, 8)
    blocks = hessian.reshape(ne, 8, 3, 8, 3)
    for k in range(3):
        blocks[:, :, k, :, k] += geometric
    return ElementResponse(energy, gradient, hessian)
