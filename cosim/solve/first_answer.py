"""A hood's first answer at rest, kept from one process to the next."""

from __future__ import annotations

import numpy as np

from cosim.array_cache import user_cache
from cosim.coupling.equilibrium import LOOSE, first_answer
from cosim.port import Array, Pair, PairState, Response, StorableHood


def kept_first_answer(pair: Pair, start: PairState, tension: Array) -> Response:
    """The `first_answer` to tensions (nt,) N, read from the user's cache where an earlier process
    has kept it.  Raises ConvergenceError."""
    match pair.hood.with_tolerance(LOOSE):
        case StorableHood() as hood:
            key = hood.first_key(start.hood, pair.finger.motion(start.finger), tension)
            if key is not None:
                return _read_or_solve(hood, key, pair, start, tension)
    return first_answer(pair, start, tension)


def _read_or_solve(
    hood: StorableHood, key: str, pair: Pair, start: PairState, tension: Array
) -> Response:
    """The response of the state whose arrays are kept under the key.

    It is made of these arrays also where they have just been computed: what follows has the same
    bits with a cache that is warm, cold, spoilt or off.  The counts of iterations and solves are
    among them, and so are those of the solve that was kept."""
    cache = user_cache()
    arrays = None if cache is None else cache.read("equilibria", key)
    if arrays is None:
        state = first_answer(pair, start, tension).state
        arrays = {name: np.array(a, order="C") for name, a in hood.to_arrays(state).items()}
        if cache is not None:
            cache.write("equilibria", key, arrays)
    return hood.response(hood.from_arrays(arrays))
