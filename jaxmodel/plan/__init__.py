"""Where to look next (thesis ch. 4): label map, exact march, utility, search and closed loop, and the arm."""

from jaxmodel.plan.explore import Loop, explore
from jaxmodel.plan.label_map import LabelMap, object_map, unknown_map
from jaxmodel.plan.labels import Label
from jaxmodel.plan.map_update import update
from jaxmodel.plan.next_view import Search, View, ViewOutcome, next_view, utility_field
from jaxmodel.plan.ray_march import march
from jaxmodel.plan.utility import THESIS, Utility
from jaxmodel.plan.viewpoints import Circle, FixedPoint, ObservationSphere, Restricted

__all__ = [
    "THESIS",
    "Circle",
    "FixedPoint",
    "Label",
    "LabelMap",
    "Loop",
    "ObservationSphere",
    "Restricted",
    "Search",
    "Utility",
    "View",
    "ViewOutcome",
    "explore",
    "march",
    "next_view",
    "object_map",
    "unknown_map",
    "update",
    "utility_field",
]
