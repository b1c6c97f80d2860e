"""The studies that verify the shell solver."""

from __future__ import annotations

from collections.abc import Iterator

from cosim.checks import Row, Study
from fe_solver.verification import (
    benchmarks_linear,
    benchmarks_nonlinear,
    contact_rows,
    element_rows,
    fibre_rows,
    hood_rows,
    manufactured_rows,
    material_rows,
    peers,
    shear_lag,
    tangent_rows,
    thread_rows,
)
from fe_solver.verification.beams import CURVED, HOOK, STRAIGHT_BEAMS
from fe_solver.verification.benchmark import Benchmark, rows_of
from fe_solver.verification.limit_loads import HINGED_ROOFS, STRIP_BUCKLING
from fe_solver.verification.membranes import BALLOON, HENCKY
from fe_solver.verification.obstacle_course import (
    COOK,
    HEMISPHERES,
    HYPERBOLIC_PARABOLOIDS,
    PINCHED_CYLINDER,
    RANDOM_MESHES,
    ROOF,
    TWISTED_BEAMS,
)
from fe_solver.verification.tension_fields import ANNULUS, BENT_RECTANGLES, SHEAR_WEB

BENCHMARKS: dict[str, tuple[Benchmark, ...]] = {
    "straight beam": STRAIGHT_BEAMS,
    "curved beam": (CURVED,),
    "hook": (HOOK,),
    "hyperbolic paraboloid": HYPERBOLIC_PARABOLOIDS,
    "roof": (ROOF,),
    "pinched cylinder": (PINCHED_CYLINDER,),
    "Cook's membrane": (COOK,),
    "random meshes": RANDOM_MESHES,
    "twisted beam": TWISTED_BEAMS,
    "hemisphere, linear": HEMISPHERES,
    "hinged roofs": HINGED_ROOFS,
    "sideways buckling": (STRIP_BUCKLING,),
    "membranes": (HENCKY, BALLOON),
    "tension field": (SHEAR_WEB, ANNULUS, *BENT_RECTANGLES),
}
"""What both elements solve, by the name of its study."""
ENDLESS = "pinched cylinder"
"""Under its point loads a shell that shears gives way without bound: no finer mesh is judged."""


def finer_rows() -> Iterator[Row]:
    """All benchmarks that both elements solve, on meshes twice as fine."""
    for name, benchmarks in BENCHMARKS.items():
        if name != ENDLESS:
            yield from rows_of(*(b.refine() for b in benchmarks))()


STUDIES = (
    Study("element", element_rows.rows),
    Study("tangents", tangent_rows.rows),
    Study("materials", material_rows.rows),
    Study("manufactured solutions", manufactured_rows.element_rows, slow=True),
    Study("manufactured solutions, every material", manufactured_rows.material_rows, slow=True),
    Study("crossed and stretched fibres", fibre_rows.rows),
    Study("contact", contact_rows.rows),
    Study("hood", hood_rows.rows),
    Study("threads", thread_rows.rows),
    Study("plate", benchmarks_linear.plate_rows),
    Study("tapered cantilever", benchmarks_linear.taper_rows),
    Study("eccentric strip", benchmarks_linear.eccentric_rows),
    Study("folded cantilever", benchmarks_linear.bracket_rows),
    *(Study(name, rows_of(*benchmarks)) for name, benchmarks in BENCHMARKS.items()),
    Study("finer meshes", finer_rows, slow=True),
    Study("shear lag", shear_lag.rows),
    Study("end shear", benchmarks_nonlinear.shear_rows),
    Study("end shear, nine-node elements", benchmarks_nonlinear.END_SHEAR.rows),
    Study("end moment", benchmarks_nonlinear.moment_rows),
    Study("hemisphere, nonlinear", benchmarks_nonlinear.hemisphere_rows),
    Study("open cylinder", benchmarks_nonlinear.open_cylinder_rows),
    Study("slit ring", benchmarks_nonlinear.ring_rows),
    Study("half cylinder", benchmarks_nonlinear.half_cylinder_rows, slow=True),
    Study(
        "large deflections, nine-node elements",
        rows_of(*benchmarks_nonlinear.NINE_NODE_PATHS),
        slow=True,
    ),
    Study(peers.title(), peers.rows),
)
