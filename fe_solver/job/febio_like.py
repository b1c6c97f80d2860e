"""What FEBio's shells and contact do otherwise than ours, so that the two can be compared.

FEBio's four-node shells (`quad4`, `q4ans`) move their two faces independently, so that the strain
through the thickness is constant there.  In bending Poisson's contraction is linear through the
thickness and so is held back: the sheet bends as if stiffer ("thickness locking": Bischoff and Ramm
1997, Int J Numer Meth Eng 40:4427), by (1 - nu)^2 / (1 - 2 nu) for an isotropic one, 1.8 at nu =
0.4.  Transverse shear has no correction factor, and that in the plane is bilinear.  Contact acts at
the integration points of the flat facets, which lie nearer to a convex bone than the nodes do.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array
from fe_solver.elements.mesh_geometry import node_directors
from fe_solver.job.job import ContactPair, Job
from fe_solver.materials.fibres import TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Law
from fe_solver.materials.section import Patch
from fe_solver.materials.tension_field import TensionField

GAUSS_SHARE = 2 / 3
"""1 - r^2 at a Gauss point: of a parabola's rise over its chord."""


class Through(NamedTuple):
    """Moduli at rest, Pa, of the strain through the thickness: by it and by those in the plane."""

    own: float
    plane: tuple[float, float]


def febio_patch(patch: Patch) -> Patch:
    """The patch with FEBio's bending and transverse shear; with its own bending where FEBio's is
    not known."""
    through = _through(patch.law)
    if through is None:
        return replace(patch, shear_correction=1.0)
    own, (a, b) = through
    held = np.zeros((3, 3))
    held[:2, :2] = np.array([[a * a, a * b], [a * b, b * b]]) / own
    return replace(patch, bending=held, shear_correction=1.0)


def bending_notes(job: Job) -> list[str]:
    """The parts of a job that do not bend as FEBio's."""
    return [
        f"part {part.name!r}: bends as a thin sheet does, as FEBio's way is known for isotropic "
        "elastic, neo-Hookean and trans iso Mooney-Rivlin with a finite k only"
        for part in job.parts
        if _through(part.law) is None
    ]


def _through(law: Law | TensionField) -> Through | None:
    match law:
        case Isotropic() | NeoHookean():
            E, nu = float(law.E), float(law.nu)
            lame = E * nu / ((1 + nu) * (1 - 2 * nu))
            return Through(lame + E / (1 + nu), (lame, lame))
        case TransIsoMooneyRivlin() if np.isfinite(law.k):
            k, mu = float(law.k), 2 * float(law.c1 + law.c2)
            fibre = float(law.c3 * law.c4)  # modulus of the deviatoric stretch at rest
            across = k - 2 * mu / 3 + fibre / 9
            return Through(k + 4 * mu / 3 + fibre / 9, (across - fibre / 3, across))
    return None


def facet_lift(job: Job, pair: ContactPair) -> Array:
    """(n,) m by which the Gauss points of the flat quads around a node lie nearer to the body than
    the curved sheet through the nodes does: parabolas over the quads' edges, from the nodes'
    normals."""
    q, d = job.quads[pair.quads], node_directors(job.points, job.quads)
    rise = np.stack(
        [_rise(job.points, d, q[:, i], q[:, j]) for i, j in ((0, 1), (3, 2), (0, 3), (1, 2))]
    )
    lift = -pair.side * GAUSS_SHARE * rise.sum(axis=0) / 2
    total = np.bincount(q.ravel(), weights=np.repeat(lift, 4), minlength=len(job.points))
    return total / np.maximum(np.bincount(q.ravel(), minlength=len(job.points)), 1)


def _rise(x: Array, d: Array, i: NDArray[np.intp], j: NDArray[np.intp]) -> Array:
    """(k,) m along the directors of an edge's middle over its chord."""
    return np.asarray(np.einsum("ek,ek->e", d[j] - d[i], x[j] - x[i]) / 8)
