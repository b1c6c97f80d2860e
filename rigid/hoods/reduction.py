"""The potential of a hood from what it did on held bones, by linear least squares.

Every sample gives the gradient of the potential in angles and tensions (torques and excursions)
and its second derivatives (stiffness, arms, compliance), to which one polynomial is fitted at once,
so that what is measured as a torque and what is measured as an excursion agree.  The slips' forces
are fitted beside it.  What is fitted and how it is weighted is in `rigid.hoods.reduced_fit`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array
from rigid.hoods.reduced import ReducedPotential
from rigid.hoods.reduced_fit import energy, slips
from rigid.hoods.reduced_sample import Sample

HELD = 0.1
"""rad."""
STILL = 1e-9
"""rad."""
DEFAULT_TOE = 0.03
MEASURED = ("torque", "excursion", "stiffness", "arms", "compliance")


@dataclass(frozen=True)
class Order:
    """How rich the potential is."""

    angle: int = 9
    """Total degree in the joints that the samples move."""
    held: int = 2
    """Degree in the joints that they all leave where they are, whose torques and stiffnesses they
    tell; it counts twice against `angle`, but terms of degree 1 beside it always stay."""
    toe: float | None = 0.03
    """Share of the greatest tensions where the toe of an exponential spring ends; without it
    springs are straight."""


RICHEST, SLIP_ORDER = Order(), Order(angle=2, held=0)
ENOUGH = 9
"""Numbers to a term: with fewer the potential follows its samples and errs between them."""


def angle_powers(moves: NDArray[np.bool_], order: Order) -> NDArray[np.intp]:
    """(A, n) whole numbers, of the joints (n,) that move or are held."""
    most = [order.angle if move else order.held for move in moves]
    powers = np.array(list(product(*(range(p + 1) for p in most))))
    held = powers[:, ~moves].sum(axis=1)
    left = np.where(held > 0, np.maximum(order.angle - 2 * held + 1, 1), order.angle)
    found: NDArray[np.intp] = powers[(powers[:, moves].sum(axis=1) <= left) & (held <= order.held)]
    return found


def tension_terms(muscles: int, order: Order) -> NDArray[np.intp]:
    """(G, m): none, each muscle alone, and pairs of different ones."""
    one, functions = np.eye(muscles, dtype=int), (1, 2) if order.toe is None else (1, 2, 3)
    alone = [k * row for row in one for k in functions]
    pairs = [one[i] + one[k] for i in range(muscles) for k in range(i)]
    return np.array([np.zeros(muscles, dtype=int), *alone, *pairs])


def richest_order(numbers: int, moves: NDArray[np.bool_], muscles: int) -> Order:
    """The richest order with ENOUGH numbers to a term, of at least degree 1."""
    per_angle = ENOUGH * len(tension_terms(muscles, RICHEST))
    orders = (replace(RICHEST, angle=degree) for degree in range(RICHEST.angle, 1, -1))
    fitting = (o for o in orders if len(angle_powers(moves, o)) * per_angle <= numbers)
    return next(fitting, replace(RICHEST, angle=1))


def reduce_hood(
    data: Sample,
    joints: tuple[str, ...],
    muscles: tuple[str, ...],
    order: Order | None = None,
    maps: Array | None = None,
) -> ReducedPotential:
    """The potential over the box of the samples, without `order` as rich as they bear; joints that
    all samples hold still get a box of HELD to either side.  With `maps` (s, 3, n), N/(N m), from
    joint torques to the force of a fingertip, the fit is to that force too.

    Raises InputError where there are fewer numbers than terms."""
    low, high = data.angle.min(axis=0), data.angle.max(axis=0)
    moves = high - low > STILL
    numbers = sum(getattr(data, name).size for name in MEASURED)
    order = richest_order(numbers, moves, len(muscles)) if order is None else order
    powers, terms = angle_powers(moves, order), tension_terms(len(muscles), order)
    none = np.zeros((len(powers), len(terms)))
    empty = ReducedPotential(
        joints,
        muscles,
        np.where(moves, low, low - HELD),
        np.where(moves, high, high + HELD),
        data.tension.max(axis=0),
        powers,
        terms,
        DEFAULT_TOE if order.toe is None else order.toe,
        none,
        slip_powers := angle_powers(moves, SLIP_ORDER),
        np.zeros((2, len(slip_powers), 1 + len(joints))),
    )
    if numbers < none.size:
        raise InputError(
            f"reduction: {numbers} numbers of {len(data.angle)} samples are too few for "
            f"{none.size} terms; take more postures or loads"
        )
    found = replace(empty, energy=energy(empty, data, maps))
    return replace(found, slip=slips(found, data))
