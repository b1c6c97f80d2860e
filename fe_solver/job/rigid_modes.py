"""Whether an equilibrium is held: the rigid motions of a sheet that nothing resists.

Newton stops at once where a sheet that nothing holds carries no load, so that an equilibrium alone
does not say that a model is complete.  Here each connected piece of the mesh is moved as a rigid
body within what ties and guides allow, and the tangent is asked for its resistance: springs,
contact, friction and the sheet's own tension are all in it, so that a sheet that hangs from strings
is held, as a pendulum is.

A sheet that rests without friction on a baked surface counts as held along it: the spline through
a flat face is not quite flat, and its ripples hold the sheet where it was put.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.job.job import Job
from fe_solver.solver.assembly import DOFS
from fe_solver.solver.model import Configuration, Evaluation, ShellModel

ALLOWED = 1e-12
"""Share of a motion's squared size that ties and guides may take before they forbid it."""
PRODUCT_ROUNDING = 10 * np.finfo(float).eps
"""Share of the sum of the products' magnitudes: a resistance below it is rounding error."""
NO_COMPONENT = 1e-6
"""Share of a motion's size: less of a component is none."""


@dataclass(frozen=True)
class FreeMotions:
    """The m rigid motions of one piece of the sheet that nothing resists, each of unit size."""

    nodes: Ints
    """(k,) nodes of the piece."""
    pieces: int
    """Number of pieces that the sheet has."""
    shift: Array
    """(m, 3) m, velocities of the piece's middle."""
    turn: Array
    """(m, 3), rotations (rad) times the piece's length."""
    middle: Array
    """(3,) m, middle of the piece, world."""
    length: float
    """m, size of the piece."""

    def words(self) -> str:
        """The motions, as a person would tell them."""
        turns = int(np.linalg.matrix_rank(self.turn, NO_COMPONENT))
        slides = len(self.turn) - turns
        if slides and not turns:
            return f"move along {_axes(self.shift)}"
        if turns == 1 and not slides:
            return f"turn about {self._axis()}"
        kinds = [(slides, "translation"), (turns, "rotation")]
        parts = [f"{n} {kind}{'s' * (n > 1)}" for n, kind in kinds if n]
        return f"move freely ({' and '.join(parts)})"

    def _axis(self) -> str:
        """The direction of the only turn and a point on its axis, in words."""
        turn, shift = self.turn[0], self.shift[0]
        size = np.linalg.norm(turn)
        point = self.middle + self.length * np.cross(turn, shift) / size**2
        place = ", ".join(f"{1e3 * v:.4g}" for v in point + 0.0)
        screw = " and along it" if abs(shift @ turn) > NO_COMPONENT * size else ""
        return f"{_axes(turn[None] / size)} through ({place}) mm{screw}"


def _axes(directions: Array) -> str:
    """Unit directions (m, 3) in words."""
    whole = [a for a, e in zip("xyz", np.eye(3), strict=True) if _is_spanned(e, directions)]
    if len(whole) == len(directions):
        return " and ".join(whole)
    if len(directions) == 1:
        return f"({', '.join(f'{v:.3g}' for v in directions[0])})"
    return f"{len(directions)} directions"


def _is_spanned(e: Array, directions: Array) -> bool:
    """Whether a unit vector (3,) lies in the span of directions (m, 3)."""
    basis = np.linalg.svd(directions, full_matrices=False)[2]
    return bool(np.linalg.norm(basis @ e) > 1 - NO_COMPONENT)


def unsupported(job: Job, time: float, motions: Sequence[FreeMotions]) -> InputError:
    """The error, naming the piece, the time and the motions, for an equilibrium of a job that
    leaves the sheet free to move: a piece of it as a rigid body where there are such `motions`."""
    what = "the sheet can move"
    if motions:
        free = motions[0]
        more = "" if free.pieces == 1 else f", one of {free.pieces} pieces,"
        what = f"the sheet of {job.sheet.node(free.nodes[0])}{more} can {free.words()}"
    return InputError(
        f"{job.name}: at t = {time:.6g} {what}, and nothing resists it: the answer would be one of "
        "many. Tie it to a body, hold more of its displacements, or give it springs that are taut"
    )


def require_supports(
    job: Job, time: float, model: ShellModel, c: Configuration, e: Evaluation
) -> None:
    """Check that an equilibrium of a job with its tangent leaves no piece of the sheet free to move
    as a rigid body.  Raises InputError as `unsupported` says."""
    motions = rigid_freedoms(model, c, e)
    if motions:
        raise unsupported(job, time, motions)


def rigid_freedoms(model: ShellModel, c: Configuration, e: Evaluation) -> tuple[FreeMotions, ...]:
    """The pieces of the sheet that can move as rigid bodies without resistance at an equilibrium
    evaluated with its tangent."""
    assert e.data is not None
    piece = Pieces.of(model.quads, c.x)
    free = np.zeros(len(c.x) * DOFS, dtype=bool)
    free[model.free] = True
    tangent = model.pattern.full(e.data)[model.free][:, model.free]
    missed = float(np.abs(e.reduced[model.free]).sum())
    return free_motions(piece, _shell_moves(c, e, piece), free, tangent, missed)


def free_motions(
    pieces: Pieces, moves: Array, free: NDArray[np.bool_], tangent: Any, missed: float
) -> tuple[FreeMotions, ...]:
    """The pieces that can move as rigid bodies without resistance, by the `moves` (n, m, 6) of the
    nodes' m degrees of freedom (m; then turns, rad over the piece's length), which of them are
    `free` (n m), the tangent (sparse) of these, and the residual N (its sum) that Newton left.

    The motions q (a velocity of the middle, a turn times the piece's length) that ties and guides
    allow are those that leave the held degrees of freedom in place; of them, those are free whose
    change of force, K q as all such motions feel it (not symmetric under a pressure), is not above
    its rounding error and the residual that Newton left, which turns with the piece."""
    piece, count, middle, length = pieces
    n, dofs, _ = moves.shape
    allowed = [
        _admissible_motions(moves, free.reshape(n, dofs), piece == p, length[p])
        for p in range(count)
    ]
    widths = [z.shape[1] for z in allowed]
    columns = np.zeros((n, dofs, sum(widths)))
    if not any(widths):
        return ()
    ends = np.cumsum(widths)
    for p, (z, end) in enumerate(zip(allowed, ends, strict=True)):
        columns[piece == p, :, end - len(z.T) : end] = moves[piece == p] @ z
    moved = columns.reshape(-1, sum(widths))[free]
    null = _free_combinations(tangent, moved, missed / float(length.min()))
    out = []
    for p, (z, end) in enumerate(zip(allowed, ends, strict=True)):
        basis = _basis(z @ null[end - len(z.T) : end])
        if len(basis):
            nodes = np.flatnonzero(piece == p)
            out.append(
                FreeMotions(nodes, count, basis[:, :3], basis[:, 3:], middle[p], float(length[p]))
            )
    return tuple(out)


class Pieces(NamedTuple):
    """The connected pieces of a sheet."""

    piece: Ints
    """(n,) number of the piece that each node is of."""
    total: int
    """Number of pieces."""
    middle: Array
    """(total, 3) m, of the pieces."""
    length: Array
    """(total,) m, of the pieces."""

    @classmethod
    def of(cls, elements: Ints, x: Array) -> Pieces:
        """Those of elements (ne, k) with nodes x (n, 3) m."""
        n, k = len(x), elements.shape[1]
        edges = np.concatenate([elements[:, [i, i + 1]] for i in range(k - 1)])
        graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
        count, piece = connected_components(graph, directed=False)
        return cls(piece.astype(np.intp), int(count), *_sizes(x, piece, int(count)))

    def turns(self, x: Array) -> Array:
        """The moves (3, n, 3) m of nodes x (n, 3) m by turns about x, y, z of their pieces, each
        over its length."""
        arm = (x - self.middle[self.piece]) / self.length[self.piece][:, None]
        return np.stack([np.cross(axis, arm) for axis in np.eye(3)])


def _sizes(x: Array, piece: Ints, count: int) -> tuple[Array, Array]:
    """Middle (count, 3) m and length (count,) m of each piece."""
    size = np.bincount(piece, minlength=count)[:, None]
    middle = np.zeros((count, 3))
    np.add.at(middle, piece, x)
    middle /= size
    length = np.zeros(count)
    np.maximum.at(length, piece, np.linalg.norm(x - middle[piece], axis=1))
    return middle, length


def _shell_moves(c: Configuration, e: Evaluation, pieces: Pieces) -> Array:
    """The nodes' degrees of freedom by the six rigid motions of their pieces (n, 5, 6)."""
    A, T = e.bases
    out = np.zeros((len(c.x), DOFS, 6))
    out[:, :3, :3] = np.swapaxes(A, 1, 2)
    along = c.d / pieces.length[pieces.piece][:, None]
    for k, (axis, turned) in enumerate(zip(np.eye(3), pieces.turns(c.x), strict=True)):
        out[:, :3, 3 + k] = np.einsum("nij,ni->nj", A, turned)
        out[:, 3:, 3 + k] = np.einsum("nij,ni->nj", T, np.cross(axis, along))
    return out


def _admissible_motions(
    moves: Array, free: NDArray[np.bool_], of_piece: NDArray[np.bool_], length: float
) -> Array:
    """The motions (6, m) of a piece, whose nodes are `of_piece` (n,), that move none of the degrees
    of freedom that are not free (n, k): three displacements (m), then turns (rad)."""
    rows = moves * np.where(np.arange(moves.shape[1]) < 3, 1.0, length)[:, None]
    rows = rows[~free & of_piece[:, None]]
    taken, directions = np.linalg.eigh(rows.T @ rows)
    return np.asarray(directions[:, taken <= ALLOWED * max(1, len(rows))])


def _free_combinations(tangent: Any, moved: Array, missed: float) -> Array:
    """The combinations (m, k) of motions, `moved` (free dofs, m), that the tangent does not resist,
    beside a residual `missed` (N over the piece's length)."""
    resistance = moved.T @ (tangent @ moved)
    sums = np.abs(moved) * (abs(tangent) @ np.abs(moved))
    limit = PRODUCT_ROUNDING * sums.sum(axis=0).max(initial=0.0) + missed
    _, size, directions = np.linalg.svd(resistance)
    return np.asarray(directions[size <= limit].T)


def _basis(motions: Array) -> Array:
    """The orthonormal rows (m, 6) that span the columns of motions (6, k)."""
    directions, size, _ = np.linalg.svd(motions, full_matrices=False)
    return np.asarray(directions[:, size > NO_COMPONENT].T)
