"""What pythonfmu leaves out of a unit's description: units, exact start values, what a loader must
know."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from cosim.fmu.quantity import UNITS, Quantity
from cosim.fmu_export.run import UnitRun


def finish_description(root: Element, run: UnitRun) -> Element:
    """The description `root` with its start values to the last bit and its units, and without the
    date, so that the same unit is the same file."""
    if root.get("fmiVersion") == "2.0":
        _finish_scalars(root, run)
        _repeat_outputs(root)
    else:
        _finish_arrays(root, run)
    used = {q.unit for q in run.quantities if q.unit}
    definitions = Element("UnitDefinitions")
    for name in sorted(used):
        unit = SubElement(definitions, "Unit", name=name)
        SubElement(unit, "BaseUnit", {base: str(power) for base, power in UNITS[name].items()})
    del root.attrib["generationDateAndTime"]
    interface = [child.tag for child in root].index("CoSimulation")
    root.insert(interface + 1, definitions)
    return root


def _finish_scalars(root: Element, run: UnitRun) -> None:
    variables = root.findall("ModelVariables/ScalarVariable")
    place = 0
    for quantity in run.quantities:
        for _ in range(quantity.zero().size):
            (value,) = variables[place]
            _state(value, quantity, run.get([place]))
            place += 1


def _repeat_outputs(root: Element) -> None:
    """All outputs follow from the inputs at the start too; pythonfmu says so for FMI 3 alone."""
    unknown = SubElement(_find(root, "ModelStructure"), "InitialUnknowns")
    unknown.extend(_find(root, "ModelStructure/Outputs").findall("Unknown"))


def _find(root: Element, path: str) -> Element:
    element = root.find(path)
    assert element is not None
    return element


def _finish_arrays(root: Element, run: UnitRun) -> None:
    variables = _find(root, "ModelVariables")
    for variable, quantity in zip(variables, run.quantities, strict=False):
        _state(variable, quantity, run.get(run.place[quantity.name]))


def _state(element: Element, quantity: Quantity, start: list[float]) -> None:
    """Start values of a variable that is no output, and its unit; FMI takes one value for all of an
    array."""
    if quantity.unit:
        element.set("unit", quantity.unit)
    if quantity.causality == "output":
        return
    if quantity.switch:
        element.set("start", "true" if start[0] else "false")
        return
    same = len(set(start)) == 1
    element.set("start", " ".join(map(repr, start[:1] if same else start)))
