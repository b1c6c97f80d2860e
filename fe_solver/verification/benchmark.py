"""Problems whose answers are published, solved by both shell elements on ever finer meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from cosim.verification import Row

from .paths import halving_order

Solve = Callable[[int, int], Sequence[float]]
"""The quantities of a problem, from the mesh's size and the number of nodes of its elements."""
WORDS = {4: "four", 9: "nine"}


def square(n: int) -> str:
    """The words for a mesh of n x n elements."""
    return f"{n} x {n}"


@dataclass(frozen=True)
class Meshes:
    """The sizes of the meshes that one element solves a problem on, the coarsest first.

    The finest is judged: its error must be at most `within`.  The coarsest is shown, and judged by
    `coarse` where that is given."""

    sizes: tuple[int, ...]
    within: float = 0.01
    coarse: float | None = None


@dataclass(frozen=True)
class Benchmark:
    """A problem and the values of its quantities.

    `targets` maps the words for each quantity to its published value, in the order in which `solve`
    gives them; `problem` says geometry, material and load, `source` where the targets are from.
    `meshes` holds the meshes of each element by its number of nodes, `words` names a mesh by its
    size."""

    name: str
    problem: str
    targets: dict[str, float]
    source: str
    solve: Solve
    meshes: dict[int, Meshes]
    words: Callable[[int], str] = square

    def rows(self) -> Iterator[Row]:
        """Of each element the coarsest and the finest mesh; the order is that of the last three
        meshes.  Raises ConvergenceError."""
        for nodes, meshes in self.meshes.items():
            values = [tuple(self.solve(size, nodes)) for size in meshes.sizes]
            for i, (what, target) in enumerate(self.targets.items()):
                yield from self._of_quantity(nodes, what, target, [v[i] for v in values])

    def _of_quantity(
        self, nodes: int, what: str, target: float, values: list[float]
    ) -> Iterator[Row]:
        meshes, last = self.meshes[nodes], len(values) - 1
        for k in sorted({0, last}):
            within = meshes.within if k == last else meshes.coarse
            yield Row(
                f"{self.name}, {WORDS[nodes]}-node elements",
                f"{what}, {self.words(meshes.sizes[k])}",
                target,
                float(values[k]),
                0.0 if within is None else within,
                f"{self.problem}; {self.source}",
                "shown" if within is None else "relative",
                halving_order(*values[-3:]) if k == last and last >= 2 else None,
            )


def rows_of(*benchmarks: Benchmark) -> Callable[[], Iterator[Row]]:
    """What makes the rows of some benchmarks, for a study."""

    def make() -> Iterator[Row]:
        for benchmark in benchmarks:
            yield from benchmark.rows()

    return make
