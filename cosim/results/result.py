"""The result of a run, computed or read back from its folder: one class."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.results.audit import Audit
from cosim.results.compare import Comparison
from cosim.results.conventions import COMPONENTS, by_axis
from cosim.results.parts import CaseParts
from cosim.results.write import copy_run, write_run

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, repr=False)
class Result(CaseParts):
    """What `cosim.run` found, or what `cosim.open_run` read: the same either way.

    >>> import cosim
    >>> result = cosim.run(cosim.load("pulley_edc"))
    >>> sorted(result.tip_force)
    ['distal', 'dorsal', 'radial']
    >>> result.audit.passed
    True
    """

    name: str
    """The case's; of runs that were read together and share it, with the folder they lie in."""
    folder: Path | None = None
    """Where it was written or read; None before."""
    comparison: tuple[Comparison, ...] = ()
    """With values that were given, of a run that was read."""

    @property
    def ledger(self) -> pandas.DataFrame:
        """Every force on every body by its source: state, body, source, force (N) and moment about
        the body's origin (N m), world axes."""
        import pandas

        vectors = [(*row.force, *row.moment) for row in self.rows]
        labels = [(row.state, row.body, row.source) for row in self.rows]
        left = pandas.DataFrame(labels, columns=["state", "body", "source"])
        return left.join(pandas.DataFrame(vectors, columns=COMPONENTS))

    @property
    def tip_force(self) -> dict[str, float]:
        """N, of the fingertip on the world at the end, along the world's axes."""
        return by_axis(self.data.tip_force.isel({self.axis: -1}).values)

    @property
    def slips(self) -> dict[str, float]:
        """N, in the central and the terminal slip at the end; empty of a hood without slips."""
        return dict(self.summary.get("slip_force_N", {}))

    @property
    def audit(self) -> Audit:
        """Each figure of the audit with its bound."""
        return Audit.read(self.summary)

    def picture(self, name: str) -> bytes | None:
        """PNG, a picture that the run left in its folder: "picture", "ledger" or "history"."""
        path = None if self.folder is None else self.folder / f"{name}.png"
        return path.read_bytes() if path is not None and path.is_file() else None

    def save(self, folder: str | Path) -> Path:
        """Write the run to `folder`/<case name> and return that path; a run that was read is copied
        as it was left.

        Raises InputError where it cannot be written."""
        return (
            write_run(folder, self)
            if self.folder is None
            else copy_run(folder, self.case, self.folder)
        )

    def __repr__(self) -> str:
        force = ", ".join(f"{axis} {value:.3g}" for axis, value in self.tip_force.items())
        return f"<Result of {self.case}: fingertip force {force} N; {self.audit}>"
