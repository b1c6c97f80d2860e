"""OpenSim's ExternalLoads: forces on bodies over time in a .mot, and the .xml that says on which.

Of each body the .mot holds `BODY_force_vx, vy, vz` (N, ground's axes), `BODY_force_px, py, pz` (m,
the body's frame) and, where there is a moment, `BODY_torque_x, y, z` (N m, ground's axes).  Both
files are in the layout of OpenSim 3 (version 30000), which OpenSim 4 reads as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from cosim.errors import InputError
from cosim.files import output_file
from cosim.port import Array
from rigid.opensim.sto import StoTable, write_sto

VERSION = "30000"
GROUND = "ground"
AXES = "xyz"


@dataclass(frozen=True)
class BodyLoad:
    """What acts on a body at n times."""

    body: str
    """As the OpenSim model names it."""
    force: Array
    """(n, 3) N, ground's axes."""
    point: Array
    """(3,) m, the body's frame: where the force acts."""
    moment: Array | None = None
    """(n, 3) N m, ground's axes, about that point."""


def write_external_loads(mot: Path, time: Array, loads: Sequence[BodyLoad]) -> tuple[Path, Path]:
    """Write `mot` and, beside it, the .xml of the same name; both paths.

    time: (n,) s.  Raises InputError for names that OpenSim cannot tell apart or that hold blanks,
    values that are not finite, and where a file cannot be written."""
    xml = mot.with_suffix(".xml")
    if xml == mot:
        raise InputError(f"{mot}: the .xml is written beside it; name the table .mot or .sto")
    columns: list[str] = []
    values: list[Array] = []
    for load in loads:
        parts = {f"{load.body}_force_v": load.force}
        parts[f"{load.body}_force_p"] = np.tile(load.point, (len(time), 1))
        if load.moment is not None:
            parts[f"{load.body}_torque_"] = load.moment
        for prefix, part in parts.items():
            columns += [f"{prefix}{axis}" for axis in AXES]
            values.append(part)
    table = StoTable(mot.stem.replace(" ", "_"), tuple(columns), time, np.hstack(values))
    text = external_loads_xml(mot.stem, mot.name, loads)
    write_sto(mot, table, 1)
    with output_file(xml) as part_of_xml:
        part_of_xml.write_bytes(text)
    return mot, xml


def external_loads_xml(name: str, datafile: str, loads: Sequence[BodyLoad]) -> bytes:
    """The document; `datafile` is relative to it.

    Raises InputError for a text that XML cannot hold."""
    root = etree.Element("OpenSimDocument", Version=VERSION)
    try:
        whole = etree.SubElement(root, "ExternalLoads", name=name)
        objects = etree.SubElement(whole, "objects")
        for load in loads:
            _add_force(objects, load)
        etree.SubElement(whole, "groups")
        etree.SubElement(whole, "datafile").text = datafile
    except ValueError as error:
        raise InputError(f"{datafile}: a name holds what XML cannot ({error})") from error
    etree.indent(root, "\t")
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8")) + b"\n"


def _add_force(objects: etree._Element, load: BodyLoad) -> None:
    force = etree.SubElement(objects, "ExternalForce", name=f"{load.body}_load")
    tags = {
        "isDisabled": "false",
        "applied_to_body": load.body,
        "force_expressed_in_body": GROUND,
        "point_expressed_in_body": load.body,
        "force_identifier": f"{load.body}_force_v",
        "point_identifier": f"{load.body}_force_p",
    }
    if load.moment is not None:
        tags["torque_identifier"] = f"{load.body}_torque_"
    for tag, text in tags.items():
        etree.SubElement(force, tag).text = text
