"""The fleet section: which of its forms a problem file has, by the model that it names, and how it is written back."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Tag

from ensemble_ctrl.files.config.arc_section import FleetSection, arc_fleet_data
from ensemble_ctrl.files.config.fields import Model
from ensemble_ctrl.files.config.system_section import SystemFleetSection, system_fleet_data
from ensemble_ctrl.files.config.user_system import by_ode
from ensemble_ctrl.problem.fleet import Fleet

ARCS, STATES = "by arcs", "by states"
SECTIONS: dict[str, type[Model]] = {ARCS: FleetSection, STATES: SystemFleetSection}
"""The forms of the section by their tags, which are no keys of a file."""


def form(section: Any) -> str:
    """The tag of a section that was read."""
    return STATES if by_ode({"fleet": section}) else ARCS


AnyFleet = Annotated[
    Annotated[FleetSection, Tag(ARCS)] | Annotated[SystemFleetSection, Tag(STATES)], Discriminator(form)
]


def fleet_data(fleet: Fleet) -> dict[str, Any]:
    """The section on a fleet as plain data."""
    return arc_fleet_data(fleet) if fleet.system.name in FleetSection.models() else system_fleet_data(fleet)
