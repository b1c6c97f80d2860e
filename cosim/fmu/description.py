"""Reading a description that breaks the standard in what a co-simulation does not need, as other
programs do."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lxml import etree

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

UNUSED = (
    *("ModelStructure", "VendorAnnotations", "Annotations", "LogCategories"),
    *("DefaultExperiment", "ModelExchange", "ScheduledExecution"),
)
"""Elements that nothing here depends on."""
SCALARS = ("Real", "Integer", "Boolean", "String", "Enumeration")
VARIABILITIES = {
    **dict.fromkeys(("parameter", "structuralParameter"), ("fixed", "tunable")),
    "calculatedParameter": ("fixed", "tunable"),
    "input": ("discrete", "continuous"),
    "output": ("constant", "discrete", "continuous"),
    "local": ("constant", "fixed", "tunable", "discrete", "continuous"),
    "independent": ("continuous",),
}
"""By causality the variabilities that the standard allows."""


def lenient_description(file: str) -> ModelDescription | None:
    """What a description says of its variables, units and co-simulation, whatever else is wrong in
    it: a variable without reference or type is left out, and a causality or variability that the
    standard does not know is the default.  None where it cannot be told, where no variable is left,
    or two have one name.  The file is changed."""
    from fmpy import read_model_description

    tree = etree.parse(file)
    root = tree.getroot()
    for name in UNUSED:
        for element in root.findall(name):
            root.remove(element)
    for group in root.findall("TypeDefinitions"):
        _mend_types(group)
    types = {element.get("name") for element in root.findall("TypeDefinitions/*")}
    for group in root.findall("ModelVariables"):
        _mend_variables(group, types, root.get("fmiVersion") == "2.0")
    tree.write(file, encoding="UTF-8", xml_declaration=True)
    try:
        description: ModelDescription = read_model_description(file, validate=False)
    except Exception:  # of any kind, as FMPy comes upon what it does not expect
        return None
    names = [variable.name for variable in description.modelVariables]
    return description if names and len(set(names)) == len(names) else None


def _mend_types(group: etree._Element) -> None:
    """Types without name or kind, and attributes that FMPy does not know."""
    from attrs import fields
    from fmpy.model_description import SimpleType

    known = {attribute.name for attribute in fields(SimpleType)} - {"type", "items"}
    for element in list(group):
        inner = element if element.tag != "SimpleType" else next(iter(element), None)
        if inner is None or element.get("name") is None:
            group.remove(element)
            continue
        for name in set(inner.attrib) - (known if inner is element else known - {"name"}):
            del inner.attrib[name]
        for item in inner.findall("Item"):
            inner.remove(item)


def _mend_variables(group: etree._Element, types: set[str | None], is_fmi2: bool) -> None:
    for variable in list(group):
        value = variable
        if is_fmi2:
            value = next((child for child in variable if child.tag in SCALARS), None)
        if value is None or not (variable.get("valueReference") or "").strip().isdecimal():
            group.remove(variable)
            continue
        causality = variable.get("causality", "local")
        if causality not in VARIABILITIES:
            causality = "local"
            del variable.attrib["causality"]
        if variable.get("variability") not in VARIABILITIES[causality]:
            variable.attrib.pop("variability", None)
            variable.attrib.pop("initial", None)
            if "arameter" in causality:
                variable.set("variability", "fixed")
        if value.get("declaredType") not in types:
            value.attrib.pop("declaredType", None)
        for unused in ("derivative", "clocks"):
            value.attrib.pop(unused, None)
