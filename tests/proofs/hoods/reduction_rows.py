"""The network that `cosim export` fits: to a network, which it must match, and to the shell."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial

import numpy as np

from cosim.analyses.reduction.errors import errors
from cosim.analyses.reduction.reduce import reduce_case
from cosim.analyses.reduction.samples import FREE, Walk, on_models
from cosim.analyses.reduction.walks import GRID
from cosim.case.file import find_case, load_case
from cosim.hoods.lumped.build import Sample, reduce_hood, stack
from cosim.models.build import build
from tests.helpers.rows import Row

SPRINGS = ("edc_ulnar", "edc_slip", "edc_radial", "lum_slip", "lum_lateral", "fpi_slip")
SOFT = [f'hood.connecting.{name}.stiffness="{1 + 0.2 * i} N/mm"' for i, name in enumerate(SPRINGS)]
SOFT.append('hood.connecting.fpi_lateral.stiffness="1.5 N/mm"')
"""So soft that every spring bears over the whole box, where the network is a polynomial."""
CASE = "fingertip_fibres_edc"
ROUNDING = 1e-8
FASTER = 1e-3
"""The mark is 1000 times."""
KNOWN = (
    "a network whose springs all bear is a polynomial of degree 4 in the angles, 2 in the forces"
)
MARK = "the project's mark for a network reduced from the shell, held-out postures"


def network_rows() -> Iterator[Row]:
    """A network reduced to a network, in postures and under loads that were not fitted."""
    models = build(load_case("network_edc", [*SOFT, FREE]))
    random = np.random.default_rng(0)
    low, high = [-0.1, 0.0, 0.1, 0.0], [0.6, 0.0, 0.9, 0.4]
    angle, load = random.uniform(low, high, (40, 4)), random.uniform(7.0, 12.0, (7, 3))
    states = [s for s in on_models(models, Walk(angle, load)) if isinstance(s, Sample)]
    fit, held = stack(states[:-40]), stack(states[-40:])
    fitted = reduce_hood(fit, models.finger.joints, models.hood.tendons)
    for name, value in fitted.derivatives(held.angle, held.tension)._asdict().items():
        exact = getattr(held, name)
        off = float(np.abs(value - exact).max() / np.abs(exact).max())
        yield Row("network from a network", f"{name}, relative", 0.0, off, ROUNDING, KNOWN, "bound")


def shell_rows() -> Iterator[Row]:
    """The calibrated shell."""
    result = reduce_case(find_case(CASE), (), GRID, 2, partial(print, file=sys.stderr, flush=True))
    for e in errors(result):
        if e.mark is not None:
            for word, value in (("median", e.median), ("most", e.most)):
                what = f"{e.quantity}, {word}, relative"
                yield Row("network from the shell", what, e.mark, value, 0.0, MARK, "bound")
    for word, seconds in (("one by one", result.rate.one), ("in a batch", result.rate.batched)):
        part = seconds / result.seconds
        yield Row(
            "network from the shell", f"time, {word}, of it", FASTER, part, 0.0, MARK, "shown"
        )
