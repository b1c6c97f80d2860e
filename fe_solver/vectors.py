"""Vectors of nodes: cross products, turned directors, sums by node."""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.port import Array, Ints


def cross(a: Array, b: Array) -> Array:
    """The vector products (..., 3); for the few hundred of a sheet twice as fast as numpy's."""
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def tangents(directors: Array) -> Array:
    """The orthonormal vectors (n, 3, 2) normal to the unit directors (n, 3)."""
    helper = np.zeros_like(directors)
    helper[np.arange(len(directors)), np.argmin(np.abs(directors), axis=1)] = 1.0
    t1 = cross(directors, helper)
    t1 /= np.linalg.norm(t1, axis=1, keepdims=True)
    return np.stack([t1, cross(directors, t1)], axis=2)


def turn_directors(directors: Array, basis: Array, angles: Array) -> Array:
    """Directors (n, 3) turned on the sphere by angles (n, 2) along the tangents (n, 3, 2)."""
    step = np.einsum("nij,nj->ni", basis, angles)
    size = np.linalg.norm(step, axis=1, keepdims=True)
    sinc = np.sinc(size / np.pi)
    out = np.cos(size) * directors + sinc * step
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def add_at(out: Array, index: Any, values: Array) -> None:
    """Add in place where an index may come more than once."""
    np.add.at(out, index, values)


def sum_at_nodes(index: Ints, values: Array, n: int) -> Array:
    """Sum of values (..., 3) at node indices (...) into (n, 3)."""
    flat, index = values.reshape(-1, 3), index.ravel()
    sums = [np.bincount(index, weights=flat[:, k], minlength=n) for k in range(3)]
    return np.stack(sums, axis=1).astype(float, copy=False)  # of no values they are integers
