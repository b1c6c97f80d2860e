"""The studies that verify the shell solver."""

from __future__ import annotations

from cosim.verification import Study

from . import (
    benchmarks_linear,
    benchmarks_nonlinear,
    contact_rows,
    element_rows,
    fibre_rows,
    hood_rows,
    material_rows,
    peers,
    shear_lag,
    tangent_rows,
    thread_rows,
)

STUDIES = (
    Study("element", element_rows.rows),
    Study("tangents", tangent_rows.rows),
    Study("materials", material_rows.rows),
    Study("crossed and stretched fibres", fibre_rows.rows),
    Study("contact", contact_rows.rows),
    Study("hood", hood_rows.rows),
    Study("threads", thread_rows.rows),
    Study("plate", benchmarks_linear.plate_rows),
    Study("tapered cantilever", benchmarks_linear.taper_rows),
    Study("eccentric strip", benchmarks_linear.eccentric_rows),
    Study("folded cantilever", benchmarks_linear.bracket_rows),
    Study("roof", benchmarks_linear.roof_rows),
    Study("pinched cylinder", benchmarks_linear.pinched_cylinder_rows),
    Study("bent in its plane", benchmarks_linear.in_plane_rows),
    Study("shear lag", shear_lag.rows),
    Study("twisted beam", benchmarks_linear.twisted_beam_rows),
    Study("hemisphere, linear", benchmarks_linear.hemisphere_rows),
    Study("end shear", benchmarks_nonlinear.shear_rows),
    Study("end moment", benchmarks_nonlinear.moment_rows),
    Study("hemisphere, nonlinear", benchmarks_nonlinear.hemisphere_rows),
    Study("open cylinder", benchmarks_nonlinear.open_cylinder_rows),
    Study("slit ring", benchmarks_nonlinear.ring_rows),
    Study("half cylinder", benchmarks_nonlinear.half_cylinder_rows, slow=True),
    Study(peers.title(), peers.rows),
)
