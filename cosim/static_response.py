"""A hood's response at rest, which is kept from one process to the next where it begins as laid."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from cosim.array_cache import user_cache
from cosim.port import STATIC, Array, Hood, Motion, Response, State, StorableHood


def static_response(hood: Hood, state: State, motion: Motion, tension: Array) -> Response:
    """The hood's response at rest to `motion` and `tension` (nt,) N.  From a state of its `start`
    it is read from the user's cache where an earlier process has kept it.

    Raises what `advance` does."""
    match hood:
        case StorableHood():
            key = hood.first_key(state, motion, tension)
            if key is not None:
                return _read_or_solve(hood, key, state, motion, tension)
    return hood.advance(state, motion, tension, STATIC)


def _read_or_solve(
    hood: StorableHood, key: str, start: State, motion: Motion, tension: Array
) -> Response:
    """The response of the state whose arrays are kept under the key, if they are an equilibrium.

    It is made of these arrays also where they have just been computed: what follows has the same
    bits with a cache that is warm, cold, spoilt or off.  The counts of iterations and solves are
    among them, and so are those of the solve that was kept."""
    cache = user_cache()
    arrays = None if cache is None else cache.read("equilibria", key)
    if cache is not None and arrays is not None:
        state = _kept_state(hood, arrays, motion, tension)
        if state is not None:
            return hood.response(state)
        cache.drop("equilibria", key)
    state = hood.advance(start, motion, tension, STATIC).state
    arrays = {name: np.array(a, order="C") for name, a in hood.to_arrays(state).items()}
    if cache is not None:
        cache.write("equilibria", key, arrays)
    return hood.response(hood.from_arrays(arrays))


def _kept_state(
    hood: StorableHood, arrays: Mapping[str, Array], motion: Motion, tension: Array
) -> State | None:
    """The state of arrays that were kept, None where they are no equilibrium of the hood."""
    with suppress(Exception), np.errstate(all="ignore"):  # whatever arrays of nobody's raise
        state = hood.from_arrays(arrays)
        return state if hood.is_solved(state, motion, tension) else None
    return None
