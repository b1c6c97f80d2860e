"""Strips and sheets of one material point, and slow plain answers to judge the laws by."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from cosim.port import Array
from fe_solver.materials.fibres import HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean, Potential, volume_ratio
from fe_solver.materials.linear import Law, LinearLaw


def axes(angle: float) -> Array:
    """The matrix R (3, 3) of a fibre at `angle` (rad) from x: strain in its axes is R strain
    (engineering shear), stress in x and y is R^T stress."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array(
        [[c * c, s * s, s * c], [s * s, c * c, -s * c], [-2 * s * c, 2 * s * c, c * c - s * s]]
    )


def rotate(law: Law, strain: Array, R: Array) -> tuple[Array, Array]:
    """Stress and tangent in x and y of a law whose fibre axes are R's."""
    out = law.response(R @ strain)
    return R.T @ out.stress, R.T @ out.tangent @ R


def pull_uniaxially(law: Law, strain: float, angle: float = 0.0) -> tuple[Array, Array]:
    """Strain and second Piola-Kirchhoff stress, each (3,) in x and y, of a strip pulled along x to
    the Green-Lagrange strain `strain`, free across and in shear, with the fibre at `angle`."""
    R, E = axes(angle), np.array([strain, 0.0, 0.0])
    for _ in range(60):
        S, T = rotate(law, E, R)
        step = np.linalg.solve(T[1:, 1:], -S[1:])
        E[1:] += step
        if np.abs(step).max() < 1e-15:
            break
    return E, rotate(law, E, R)[0]


def uniaxial(law: Potential, stretch: float, angle: float = 0.0) -> tuple[float, float, float]:
    """Cauchy stress (Pa), J and stretch across of a free strip pulled along x."""
    E, S = pull_uniaxially(law, (stretch**2 - 1) / 2, angle)
    J = float(volume_ratio(law, axes(angle) @ E))
    return float(S[0]) * stretch**2 / J, J, math.sqrt(1 + 2 * E[1])


def cauchy(law: Potential, F: Array, angle: float = 0.0) -> Array:
    """The Cauchy stress (2, 2) Pa at the plane deformation gradient F (2, 2)."""
    C, R = F.T @ F, axes(angle)
    E = np.array([(C[0, 0] - 1) / 2, (C[1, 1] - 1) / 2, C[0, 1]])
    S = rotate(law, E, R)[0]
    plane = F @ np.array([[S[0], S[2]], [S[2], S[1]]]) @ F.T
    return plane / float(volume_ratio(law, R @ E))


def strains(count: int, reach: float = 0.12) -> Array:
    """The strains (count, 3) that repeat, between -reach/2 and +reach."""
    return np.random.default_rng(7).uniform(-reach / 2, reach, (count, 3))


def differences(law: Law, strain: Array, step: float = 1e-6) -> tuple[float, float]:
    """Largest difference of the tangent and of the stress from central differences of the stress
    and of the energy, over each point's largest tangent and largest stress."""
    out = law.response(strain)
    by_strain, by_energy = np.empty_like(out.tangent), np.empty_like(out.stress)
    for i in range(3):
        ahead, behind = (law.response(strain + d * np.eye(3)[i]) for d in (step, -step))
        by_strain[..., i] = (ahead.stress - behind.stress) / (2 * step)
        by_energy[..., i] = (ahead.energy - behind.energy) / (2 * step)
    largest = np.abs(out.tangent).max((-1, -2))
    tangent = np.abs(by_strain - out.tangent).max((-1, -2)) / largest
    stress = np.abs(by_energy - out.stress).max(-1) / (np.abs(out.stress).max(-1) + 1e-3 * largest)
    return float(tangent.max()), float(stress.max())


def solid_energy(law: Potential, C: Array) -> float:
    """The three-dimensional energy of C (3, 3) as published, J/m3, of the compressible laws."""
    J = math.sqrt(np.linalg.det(C))
    bar = C * J ** (-2 / 3)
    I1 = float(np.trace(bar))
    I2 = (I1**2 - float(np.trace(bar @ bar))) / 2
    log = math.log(J)
    match law:
        case NeoHookean():
            lam, mu = law.lame()
            return float(mu / 2 * (np.trace(C) - 3) - mu * log + lam / 2 * log**2)
        case TransIsoMooneyRivlin():
            fibre = law.fibre_energy(np.sqrt(bar[0, 0]))
            return float(law.c1 * (I1 - 3) + law.c2 * (I2 - 3) + fibre + law.k / 2 * log**2)
        case HolzapfelGasserOgden():
            energy = law.c / 2 * (I1 - 3) + law.k / 2 * ((J**2 - 1) / 2 - log)
            for sign in (1, -1):
                a = np.array([np.cos(law.gamma), sign * np.sin(law.gamma), 0.0])
                E = law.kappa * (I1 - 3) + (1 - 3 * law.kappa) * (a @ bar @ a - 1)
                energy += law.k1 / (2 * law.k2) * np.expm1(law.k2 * max(E, 0.0) ** 2)
            return float(energy)
    raise AssertionError(law)  # of no compressible law


def least_energy(law: Potential, strain: Array) -> float:
    """Least energy over the thickness stretch, J/m3: what plane stress comes to."""

    def energy(log: float) -> float:
        e1, e2, g = strain
        return solid_energy(
            law, np.array([[1 + 2 * e1, g, 0], [g, 1 + 2 * e2, 0], [0, 0, math.exp(log)]])
        )

    return float(minimize_scalar(energy, bounds=(-1.5, 1.5), options={"xatol": 1e-10}).fun)


def strip_stress(law: Potential, strain: float, angle: float, step: float = 1e-4) -> float:
    """S11 (Pa) of a strip pulled along x to the Green-Lagrange strain `strain`, its fibre at
    `angle`: by differences of fourth order of its least energy over the strain across, the shear
    and the thickness stretch.  Nothing of the laws but their published energy is used."""
    R = axes(angle)

    def least(e: float) -> float:
        def energy(rest: Array) -> float:
            e1, e2, g = R @ [e, rest[0], rest[1]]
            C = np.array([[1 + 2 * e1, g, 0], [g, 1 + 2 * e2, 0], [0, 0, math.exp(rest[2])]])
            return solid_energy(law, C) if np.linalg.det(C) > 0 else math.inf

        start = np.array([-e / 2, 0.0, -e])
        options = {"xatol": 1e-9, "fatol": 1e-9, "maxiter": 4000, "maxfev": 4000}
        return float(minimize(energy, start, method="Nelder-Mead", options=options).fun)

    w = [least(strain + k * step) for k in (-2, -1, 1, 2)]
    return (w[0] - 8 * w[1] + 8 * w[2] - w[3]) / (12 * step)


def relaxed_energy(law: LinearLaw, strain: Array, directions: int = 20001) -> float:
    """The tension field's energy by trying every direction, J/m3 (`tension_field`, second form)."""
    Q = law.plane()
    S = Q @ strain
    if S[0] + S[1] >= 0 and S[0] * S[1] >= S[2] ** 2:
        return float(strain @ S / 2)
    t = np.linspace(0, np.pi, directions)
    v = np.stack([np.cos(t) ** 2, np.sin(t) ** 2, np.sin(t) * np.cos(t)], -1)
    compliance = np.einsum("ni,ij,nj->n", v, np.linalg.inv(Q), v)
    return float((np.maximum(v @ strain, 0) ** 2 / (2 * compliance)).max())


def least_wrinkled_energy(law: Law, strain: Array) -> float:
    """The least energy W(E + L L'), J/m3, over lower triangular L: what wrinkles leave of it."""

    def energy(low: Array) -> float:
        a, b, c = low
        return float(law.response(strain + np.array([a * a, b * b + c * c, 2 * a * b])).energy)

    most = 1e-9 * float(law.response(strain).energy)
    start, options = np.full(3, 0.1), {"xatol": 1e-6, "fatol": most, "maxiter": 4000}
    for _ in range(2):
        minimum = minimize(energy, start, method="Nelder-Mead", options=options)
        start = minimum.x + 1e-4
    return float(minimum.fun)


def fibre_tension(law: TransIsoMooneyRivlin, stretch: float) -> float:
    """l dF/dl as published, Pa."""
    c3, c4, c5, lm = (float(x) for x in (law.c3, law.c4, law.c5, law.lam_max))
    toe = c3 * math.expm1(c4 * (min(max(stretch, 1.0), lm) - 1))
    return toe if stretch < lm else c5 * stretch + (toe - c5 * lm)
