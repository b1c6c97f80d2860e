"""The results of a study as pandas and xarray, with its answers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.extras import require
from cosim.port import Array
from cosim.roughness import Roughness, roughness_along
from cosim.study import answers
from cosim.study.answers import Band, Indices, ResponseSurface, Screening, Slopes
from cosim.study.sampling import points_together
from cosim.study.surrogate import Surrogate, fit_surrogate

if TYPE_CHECKING:
    import pandas as pd
    import xarray

MARK = "study.json"
FORMAT = "cosim study 1"


class _Answers(NamedTuple):
    indices: Indices | str
    screening: Screening | None
    not_screened: str
    slopes: Slopes | None
    surface: ResponseSurface | None


@dataclass(frozen=True)
class StudyResults:
    """What `cosim study` left in a folder."""

    folder: Path
    facts: Mapping[str, Any]
    """study.json: name, title, parameters, outputs, units, sampling, store."""
    _known: dict[str, _Answers] = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row for each run, in the study's order."""
        require("reading a study's table", "pyarrow")
        import pandas as pd

        return pd.read_parquet(self.folder / "table.parquet")

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters' names, in the study's order."""
        return tuple(self.facts["parameters"])

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs' names, in the study's order."""
        return tuple(self.facts["outputs"])

    @property
    def units(self) -> Mapping[str, str]:
        """The unit of each parameter and output, by name; "1" for none."""
        return dict(self.facts["units"])

    def label(self, name: str) -> str:
        """The name of a parameter or output for people."""
        label: str = self.facts["parameters"].get(name, name.replace("_", " "))
        return label

    @property
    def numeric(self) -> tuple[str, ...]:
        """The parameters that are numbers and differ from run to run."""
        numbers = self.table[list(self.parameters)].select_dtypes("float")
        return tuple(name for name in numbers if numbers[name].nunique() > 1)

    @property
    def inputs(self) -> Array:
        """The values (n, d) of the numeric parameters."""
        return self.table[list(self.numeric)].to_numpy(float)

    def values(self, output: str) -> Array:
        """The values (n,) of an output, NaN where the run failed or has none.  Raises
        InputError."""
        if output not in self.outputs:
            raise InputError(f"no output {output!r}; there are {', '.join(self.outputs)}")
        return self.table[output].to_numpy(float)

    @cached_property
    def bands(self) -> pd.DataFrame:
        """Percentiles of the first numbers beside the case as it is (`bands.bands_of`).  Raises
        InputError of a study without."""
        return self._table_of("bands.csv", "`bands = true` in the study makes them")

    @cached_property
    def bands_over_time(self) -> pd.DataFrame:
        """The same at every time of a motion (`bands.bands_over_time`).  Raises InputError of a
        study without."""
        return self._table_of("bands_over_time.csv", "a study with bands of a motion makes them")

    def _table_of(self, name: str, advice: str) -> pd.DataFrame:
        import pandas as pd

        path = self.folder / name
        if not path.is_file():
            what = path.stem.replace("_", " ")
            raise InputError(f"{self.folder}: has no {what}; {advice}")
        return pd.read_csv(path)

    def band(self, output: str) -> Band | None:
        """Mean, SD and quantiles."""
        return answers.band(self.values(output))

    def indices(self, output: str) -> Indices | str:
        """Sobol's indices of the parameters in their order, or why there are none."""
        return self._answers(output).indices

    def sobol(self, output: str) -> Indices | None:
        """Sobol's indices where there are any."""
        indices = self.indices(output)
        return None if isinstance(indices, str) else indices

    def screening(self, output: str) -> Screening | None:
        """Morris' measures of the parameters in their order, where there are any."""
        return self._answers(output).screening

    def why_not_screened(self, output: str) -> str:
        """Why there are no measures of Morris; nothing where there are."""
        return self._answers(output).not_screened

    def slopes(self, output: str) -> Slopes | None:
        """Standardised regression coefficients of the `numeric` parameters."""
        return self._answers(output).slopes

    def surface(self, output: str) -> ResponseSurface | None:
        """A quadratic in the `numeric` parameters."""
        return self._answers(output).surface

    def too_few(self, output: str) -> list[str]:
        """What the runs are too few to say of an output, by its intervals, a sentence for each;
        none of a grid, which is no sample."""
        if self.facts["sampling"] is None:
            return []
        band, indices, slopes = self.band(output), self.sobol(output), self.slopes(output)
        found = []
        if band is not None and self.facts["sampling"]["kind"] != "morris":
            found.append(answers.too_few_for_ends(band.runs))
        if indices is not None:
            labels = [self.label(name) for name in self.parameters]
            found.append(answers.too_few_for_indices(indices, labels))
        if band is not None and slopes is not None:
            labels = [self.label(name) for name in self.numeric]
            found.append(answers.too_few_for_slopes(slopes, band.runs, labels))
        return [text for text in found if text]

    def roughness(self, output: str) -> Roughness | None:
        """What a cubic leaves of an output along the one numeric parameter of a grid; None where
        there are more parameters, or none."""
        if self.facts["sampling"] is not None or len(self.parameters) != 1 or not self.numeric:
            return None
        unit = self.units[self.numeric[0]]
        return roughness_along(self.inputs[:, 0], self.values(output), unit)

    def surrogate(self, output: str, allow_poor: bool = False) -> Surrogate:
        """A Gaussian process that answers new points with a spread (`surrogate.fit_surrogate`).
        Raises InputError, also where it is poor unless `allow_poor`."""
        values, numbers = self.values(output), self.table.select_dtypes("number").columns
        if words := [name for name in self.parameters if name not in numbers]:
            raise InputError(f"a surrogate needs numbers; {', '.join(words)} has words")
        names, unit = self.numeric, self.units[output]
        return fit_surrogate((output, unit, names), self.inputs, values, self.together, allow_poor)

    def pairs(self, output: str) -> dict[tuple[str, str], float]:
        """`ResponseSurface.pairs` by the parameters' names; empty without a surface."""
        surface = self.surface(output)
        each = {} if surface is None else surface.pairs
        return {(self.numeric[i], self.numeric[j]): change for (i, j), change in each.items()}

    def _answers(self, output: str) -> _Answers:
        if output not in self._known:
            self._known[output] = self._answers_to(self.values(output))
        return self._known[output]

    def _answers_to(self, values: Array) -> _Answers:
        sampling, count = self.facts["sampling"] or {}, len(self.parameters)
        indices: Indices | str = 'no indices: sampling.kind = "saltelli" gives them'
        screened: tuple[Screening | None, str]
        screened = None, 'no effects: sampling.kind = "morris" gives them'
        if sampling.get("kind") == "saltelli":
            indices = answers.indices(values, count, sampling["second_order"])
        if sampling.get("kind") == "morris":
            every = self.table[list(self.parameters)].to_numpy(float)
            screened = answers.screening(every, values)
        if not self.numeric:
            return _Answers(indices, *screened, None, None)
        line = answers.slopes(self.inputs, values)
        curved = answers.surface(self.inputs, values, self.together)
        return _Answers(indices, *screened, line, curved)

    @property
    def together(self) -> int:
        """How many runs in turn differ in few parameters, and would tell each other's values."""
        s = self.facts["sampling"]
        if s is None:
            return 1
        return points_together(s["kind"], len(self.parameters), s["second_order"])

    def dataset(self) -> xarray.Dataset:
        """Outputs by parameters where all of these are axes, else by run."""
        columns = [*self.parameters, *self.outputs, "status"]
        if self.facts["sampling"] is None:
            indexed = self.table.set_index(list(self.parameters))[[*self.outputs, "status"]]
            data = indexed[~indexed.index.duplicated()].to_xarray()
        else:
            data = self.table.set_index("run")[columns].to_xarray()
            data = data.set_coords([*self.parameters])
        for name, unit in self.units.items():
            data[name].attrs["units"] = unit
        return data.assign_attrs(title=self.facts["title"], case=self.facts["case"])

    def arrays(self, run: int) -> xarray.Dataset:
        """Those of a run, where the study keeps them.  Raises InputError."""
        import xarray

        key = str(self.table.set_index("run").loc[run, "key"])
        path = self.folder / self.facts["store"] / "arrays" / key[:2] / f"{key}.nc"
        if not path.is_file():
            raise InputError(f"run {run} has no arrays; `arrays = true` in the study keeps them")
        return xarray.open_dataset(path, engine="h5netcdf")

    @cached_property
    def failures(self) -> dict[tuple[str, str], list[int]]:
        """Runs by status and reason, the most frequent first."""
        bad = self.table[self.table.status != "converged"]
        by_reason = {
            (str(status), str(reason)): rows.run.tolist()
            for (status, reason), rows in bad.groupby(["status", "reason"], sort=True)
        }
        return dict(sorted(by_reason.items(), key=lambda item: -len(item[1])))


def read_study(folder: Path) -> StudyResults:
    """Read what a study left in its folder.  Raises InputError."""
    try:
        facts = json.loads((folder / MARK).read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}: holds no study ({error})") from error
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise InputError(f"{folder / MARK}: expected {FORMAT!r}")
    return StudyResults(folder, facts)


def finite(value: Array) -> list[float | None]:
    """For JSON: what is no number is null."""
    return [float(v) if np.isfinite(v) else None for v in np.ravel(value)]
