"""The studies that verify the shell solver."""

from __future__ import annotations

from cosim.verification import Study

from . import (
    beams,
    benchmarks_linear,
    benchmarks_nonlinear,
    contact_rows,
    element_rows,
    hood_rows,
    limit_loads,
    material_rows,
    membranes,
    obstacle_course,
    peers,
    shear_lag,
    tangent_rows,
    thread_rows,
)

STUDIES = (
    Study("element", element_rows.rows),
    Study("tangents", tangent_rows.rows),
    Study("materials", material_rows.rows),
    Study("contact", contact_rows.rows),
    Study("hood", hood_rows.rows),
    Study("threads", thread_rows.rows),
    Study("plate", benchmarks_linear.plate_rows),
    Study("tapered cantilever", benchmarks_linear.taper_rows),
    Study("eccentric strip", benchmarks_linear.eccentric_rows),
    Study("folded cantilever", benchmarks_linear.bracket_rows),
    Study("straight beam", beams.straight_rows),
    Study("curved beam", beams.curved_rows),
    Study("hook", beams.hook_rows),
    Study("hyperbolic paraboloid", obstacle_course.hyperbolic_paraboloid_rows),
    Study("roof", obstacle_course.roof_rows),
    Study("pinched cylinder", obstacle_course.pinched_cylinder_rows),
    Study("Cook's membrane", obstacle_course.cook_rows),
    Study("random meshes", obstacle_course.random_rows),
    Study("shear lag", shear_lag.rows),
    Study("twisted beam", obstacle_course.twisted_beam_rows),
    Study("hemisphere, linear", obstacle_course.hemisphere_rows),
    Study("hinged roofs", limit_loads.hinged_roof_rows),
    Study("sideways buckling", limit_loads.strip_buckling_rows),
    Study("membranes", membranes.membrane_rows),
    Study("end shear", benchmarks_nonlinear.shear_rows),
    Study("end moment", benchmarks_nonlinear.moment_rows),
    Study("hemisphere, nonlinear", benchmarks_nonlinear.hemisphere_rows),
    Study("open cylinder", benchmarks_nonlinear.open_cylinder_rows),
    Study("slit ring", benchmarks_nonlinear.ring_rows),
    Study("half cylinder", benchmarks_nonlinear.half_cylinder_rows, slow=True),
    Study(peers.title(), peers.rows),
)
