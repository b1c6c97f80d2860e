"""A model's `<default>` classes stated on its own elements, so that they change nothing that is
added to it.

MuJoCo's writer leaves out of an element what is as its class says, whatever attributes there are;
putting the class's attributes back is its inverse and needs no list of them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

MAIN = "main"
OF_SECTION = {"equality": "equality", "tendon": "tendon", "actuator": "general"}
"""The kind under which a class speaks of all elements of a section; else it is the element's."""
SECTIONS = ("asset", "contact", "deformable", *OF_SECTION)
Facts = dict[str, dict[str, str]]
"""Attributes by kind."""


def state_defaults(root: ET.Element) -> None:
    """Put the attributes of all classes onto the elements of a model that MuJoCo wrote, and take
    the classes away."""
    classes: dict[str, Facts] = {}
    for tag in root.findall("default"):
        _read(tag, {}, classes)
        root.remove(tag)
    for section in root:
        if section.tag == "worldbody":
            _state_body(section, MAIN, classes)
        elif section.tag in SECTIONS:
            for tag in section:
                _state(tag, OF_SECTION.get(section.tag, tag.tag), MAIN, classes)


def _read(default: ET.Element, above: Facts, classes: dict[str, Facts]) -> None:
    facts = {kind: dict(of_kind) for kind, of_kind in above.items()}
    for tag in default:
        if tag.tag != "default":
            facts.setdefault(tag.tag, {}).update(tag.attrib)
    classes[default.get("class", MAIN)] = facts
    for tag in default.findall("default"):
        _read(tag, facts, classes)


def _state_body(body: ET.Element, name: str, classes: Mapping[str, Facts]) -> None:
    name = body.attrib.pop("childclass", name)
    for tag in body:
        if tag.tag in ("body", "frame"):
            _state_body(tag, name, classes)
        else:
            _state(tag, tag.tag, name, classes)


def _state(tag: ET.Element, kind: str, name: str, classes: Mapping[str, Facts]) -> None:
    facts = dict(classes.get(tag.attrib.pop("class", name), {}).get(kind, {}))
    if "cranksite" not in tag.attrib:
        facts.pop("cranklength", None)  # which MuJoCo takes of a class, but of no other actuator
    tag.attrib = {**facts, **tag.attrib}
