"""Problems whose answers are published, solved by both shell elements on ever finer meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from cosim.port import Array
from tests.helpers.rows import Row
from tests.proofs.fe.paths import halving_order

Solve = Callable[[int, int], Sequence[float] | Array]
"""The quantities of a problem, from the mesh's size and the number of nodes of its elements."""
WORDS = {4: "four", 9: "nine"}


def square(n: int) -> str:
    """The words for a mesh of n x n elements."""
    return f"{n} x {n}"


@dataclass(frozen=True)
class Meshes:
    """The meshes that one element solves a problem on."""

    sizes: tuple[int, ...]
    """The coarsest first, which is shown in any case; the finest is judged."""
    within: float = 0.01
    """Its largest error."""
    also: dict[int, float] = field(default_factory=dict)
    """The largest error of other meshes by size."""

    @property
    def tolerances(self) -> dict[int, float | None]:
        """By the size of each mesh that has a row, ascending; None where it is only shown."""
        judged = {self.sizes[0]: None} | self.also | {self.sizes[-1]: self.within}
        return dict(sorted(judged.items()))

    def refine(self) -> Meshes:
        """Return meshes without the coarsest, and with one that is twice as fine as the finest."""
        return Meshes((*self.sizes[1:], 2 * self.sizes[-1]), self.within)


@dataclass(frozen=True)
class Benchmark:
    """A problem and the values of its quantities."""

    name: str
    problem: str
    """Geometry, material and load."""
    targets: dict[str, float]
    """The published value by the words for each quantity, in the order in which `solve` gives
    them."""
    source: str
    """Where the targets are from."""
    solve: Solve
    meshes: dict[int, Meshes]
    """Of each element by its number of nodes."""
    words: Callable[[int], str] = square
    """What a mesh of a size is called."""

    def rows(self) -> Iterator[Row]:
        """Yield for each element the coarsest and the finest mesh and those that are judged
        besides; the order is that of the last three meshes. Raises ConvergenceError."""
        for nodes, meshes in self.meshes.items():
            values = {size: self.solve(size, nodes) for size in meshes.sizes}
            for i, (what, target) in enumerate(self.targets.items()):
                of_sizes = {size: float(v[i]) for size, v in values.items()}
                yield from self._of_quantity(nodes, what, target, of_sizes)

    def _of_quantity(
        self, nodes: int, what: str, target: float, values: dict[int, float]
    ) -> Iterator[Row]:
        order = halving_order(*list(values.values())[-3:]) if len(values) > 2 else None
        finest = self.meshes[nodes].sizes[-1]
        for size, within in self.meshes[nodes].tolerances.items():
            yield Row(
                f"{self.name}, {WORDS[nodes]}-node elements",
                f"{what}, {self.words(size)}",
                target,
                values[size],
                0.0 if within is None else within,
                f"{self.problem}; {self.source}",
                "shown" if within is None else "relative",
                order if size == finest else None,
            )

    def refine(self) -> Benchmark:
        """Return the benchmark on finer meshes."""
        return replace(self, meshes={k: m.refine() for k, m in self.meshes.items()})


def rows_of(*benchmarks: Benchmark) -> Callable[[], Iterator[Row]]:
    """What makes the rows of some benchmarks, for a study."""

    def make() -> Iterator[Row]:
        for benchmark in benchmarks:
            yield from benchmark.rows()

    return make
