"""The FMI 3 face of a written unit; a copy of this file goes into the archive as its script.

It raises nothing while it is imported: the loader of FMI 3 would hang for ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from pythonfmu3 import (
    Boolean,
    Dimension,
    Float64,
    Fmi3Causality,
    Fmi3Initial,
    Fmi3Slave,
    Fmi3StepResult,
    Fmi3Variability,
)
from pythonfmu3.default_experiment import DefaultExperiment
from pythonfmu3.enums import Fmi3Status

try:
    from cosim.fmu.quantity import Quantity
    from cosim.fmu_export.describe import finish_description
    from cosim.fmu_export.hooks import Stateful
    from cosim.fmu_export.run import UnitRun
except ImportError as error:
    fault = f"{Path(__file__).with_name('needs.txt').read_text('utf-8')} ({error})"

    class Stateful:  # type: ignore[no-redef]
        """Says which program is needed."""

        def __init__(self, **kwargs: Any) -> None:
            raise ImportError(fault)


class CosimFmu3(Stateful, Fmi3Slave):
    """A value reference counts the run's quantities; time has the one after them."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.run = UnitRun(Path(self.resources))
        self.modelName, self.description = self.run.name, self.run.description
        self.guid = self.run.token
        self.default_experiment = DefaultExperiment(0.0, self.run.stop_time, self.run.step_size)
        self._places = [self.run.place[q.name] for q in self.run.quantities]
        for quantity in self.run.quantities:
            self.register_variable(_variable(quantity), nested=False)
        independent = {"causality": Fmi3Causality.independent, "getter": lambda: self.run.time}
        self.register_variable(
            Float64("time", variability=Fmi3Variability.continuous, **independent), nested=False
        )

    def to_xml(self, model_options: Any = None) -> Element:
        writes = self.run.serialises
        options = {"canGetAndSetFMUState": True, "canSerializeFMUState": writes}
        return finish_description(super().to_xml(options), self.run)

    def do_step(self, current_time: float, step_size: float) -> Fmi3StepResult:
        fault = self.run.step(current_time, step_size)
        if fault:
            self.log(fault, Fmi3Status.error)
            return Fmi3StepResult(status=Fmi3Status.error)
        return Fmi3StepResult()

    def get_float64(self, vrs: Sequence[int]) -> list[float]:
        out: list[float] = []
        for vr in vrs:
            is_time = vr == len(self._places)
            out += [self.run.time] if is_time else self.run.get(self._entries(vr))
        return out

    def set_float64(self, vrs: Sequence[int], values: Sequence[float]) -> None:
        places = [place for vr in vrs for place in self._entries(vr)]
        self.run.set(places, values)

    def get_boolean(self, vrs: Sequence[int]) -> list[bool]:
        return [value != 0 for value in self.get_float64(vrs)]

    def set_boolean(self, vrs: Sequence[int], values: Sequence[bool]) -> None:
        self.set_float64(vrs, values)

    def _entries(self, vr: int) -> range:
        """Places of a variable; where there is none, one that `UnitRun` refuses."""
        last = self._places[-1].stop
        place = self._places[vr] if vr < len(self._places) else slice(last, last + 1)
        return range(place.start, place.stop)


def _variable(quantity: Quantity) -> Any:
    facts: dict[str, Any] = {
        "description": quantity.meaning,
        "causality": Fmi3Causality[quantity.causality],
        "variability": Fmi3Variability.continuous,
        "getter": float,
        "dimensions": [Dimension(start=str(n)) for n in quantity.shape],
    }
    if quantity.causality == "output":
        facts["initial"] = Fmi3Initial.calculated
    if quantity.causality == "parameter":
        facts["variability"] = Fmi3Variability.tunable
    return (Boolean if quantity.switch else Float64)(quantity.name, **facts)
