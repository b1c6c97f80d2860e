"""What one looks at in a solved shell: strains, stresses, slip forces, gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array
from fe_solver.forces.contact import contact_fields
from fe_solver.solver.model import Configuration, ShellModel


@dataclass(frozen=True)
class Fields:
    """Means over each quad, mid-surface; local axes 1 along the fibre, 2 across it."""

    strain: Array
    """(ne, 3) Green-Lagrange E11, E22, 2 E12."""
    stress: Array
    """(ne, 3) Pa, second Piola-Kirchhoff S11, S22, S12."""
    faces: Array
    """(ne, 2) E11 at the two faces (tangential bending included)."""
    tension: NDArray[np.int8]
    """(ne,) the `tension_field.State`, -1 where the sheet bears compression."""


def fields(model: ShellModel, c: Configuration) -> Fields:
    """Strain and stress of a configuration."""
    y = np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1)
    strain = model.tables.strain(y)
    weight = model.tables.weight / model.tables.weight.sum(axis=1, keepdims=True)
    mean = np.einsum("ng,ngc->nc", weight, strain)
    bend = mean[:, 3] * model.section.thickness.mean(axis=1) / 2
    faces = np.stack([mean[:, 0] - bend, mean[:, 0] + bend], axis=1)
    stress = np.einsum("ng,ngc->nc", weight, model.section.stress(strain))
    return Fields(mean[:, :3], stress, faces, model.section.tension_state(strain))


@dataclass(frozen=True)
class EnergyFields:
    """Means over each quad and its thickness; densities times volumes add up to the shell's energy,
    of one that relaxed to what it would store at once."""

    density: Array
    """(ne,) J/m3 of stress-free volume, bending and transverse shear included."""
    volume: Array
    """(ne,) m3, stress-free."""
    stretch: Array
    """(ne,) of the thickness at the mid-surface."""


def energy_fields(model: ShellModel, c: Configuration) -> EnergyFields:
    """Strain energy and thickness of a configuration, by the law that the residual comes from."""
    strain = model.tables.strain(np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1))
    area, each = model.tables.weight, model.tables.weight * model.section.thickness
    volume = each.sum(axis=1)
    energy = (area * model.section.strain_energy(strain)).sum(axis=1)
    stretch = (each * model.section.thickness_stretch(strain)).sum(axis=1) / volume
    return EnergyFields(energy / volume, volume, stretch)


def contact_pressure(model: ShellModel, c: Configuration) -> Array:
    """The pressure (n,) N/m2 of all bodies on each node, over its area, without friction."""
    return contact_fields(model.contacts, c.x, c.position, c.rotation).pressure.sum(axis=1)
