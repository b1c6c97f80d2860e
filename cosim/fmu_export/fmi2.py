"""The FMI 2 face of a written unit; a copy of this file goes into the archive as its script.

It raises nothing while it is imported: the loader of FMI 3 would hang for ever.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from pythonfmu import Boolean, Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.default_experiment import DefaultExperiment
from pythonfmu.enums import Fmi2Status

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


class CosimFmu2(Stateful, Fmi2Slave):
    """A value reference is the place of a value in the run's array."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.run = UnitRun(Path(self.resources))
        self.modelName, self.description = self.run.name, self.run.description
        self.guid = self.run.token
        self.default_experiment = DefaultExperiment(0.0, self.run.stop_time, self.run.step_size)
        for quantity in self.run.quantities:
            for name in quantity.entries(quantity.template):
                self.register_variable(_variable(name, quantity), nested=False)

    def to_xml(self, model_options: Any = None) -> Element:
        writes = self.run.serialises
        options = {"canGetAndSetFMUstate": True, "canSerializeFMUstate": writes}
        return finish_description(super().to_xml(options), self.run)

    def do_step(self, current_time: float, step_size: float) -> bool:
        fault = self.run.step(current_time, step_size)
        if fault:
            self.log(fault, Fmi2Status.error)
        return not fault

    def get_real(self, vrs: list[int]) -> list[float]:
        return self.run.get(vrs)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        self.run.set(vrs, values)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        return [value != 0 for value in self.run.get(vrs)]

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self.run.set(vrs, values)


def _variable(name: str, quantity: Quantity) -> Any:
    facts: dict[str, Any] = {
        "description": quantity.meaning,
        "causality": Fmi2Causality[quantity.causality],
        "variability": Fmi2Variability.continuous,
        "getter": float,
    }
    if quantity.causality == "output":
        facts["initial"] = Fmi2Initial.calculated
    if quantity.causality == "parameter":
        facts["variability"] = Fmi2Variability.tunable
    return (Boolean if quantity.switch else Real)(name, **facts)
