"""Paper 000, computed anew: figures 3, 4, 6 to 9 and what its text says of them.

Development and Validation of Modeling Framework for Interconnected Tendon Networks in Robotic and
Human Fingers."""

from __future__ import annotations

from cosim.papers.network_arms import arm_figures
from cosim.papers.network_contact import contact_figures
from cosim.papers.network_errors import error_figures
from cosim.papers.network_identification import identification_figures
from cosim.papers.network_testbed import run_figures
from cosim.report.figures import FigureStudy

STUDIES: tuple[FigureStudy, ...] = (
    FigureStudy("arms", "figure 3: effective moment arms and how sharply they switch", arm_figures),
    FigureStudy("contact", "figure 4: hard point contact, by two cases", contact_figures),
    FigureStudy(
        "identification", "section IV-B: parameters from excursions", identification_figures
    ),
    FigureStudy("runs", "figures 7 to 9: forward, inverse, circle (virtual testbed)", run_figures),
    FigureStudy("errors", "both models' errors over ten seeds (virtual testbed)", error_figures),
)
