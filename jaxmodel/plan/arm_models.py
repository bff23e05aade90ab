"""Built-in arms."""

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.plan.arm import Arm, arm_from_dh

# (a, alpha, d, theta) of the ABB IRB 140 in metres and radians, from the robot's data sheet through the tables of two
# public toolboxes that agree: ARTE (A. Gil, robots/ABB/IRB140/parameters.m) and P. Corke's (mdl_irb140)
IRB_140_ROWS = (
    (0.070, -np.pi / 2, 0.352, 0.0),
    (0.360, 0.0, 0.0, -np.pi / 2),
    (0.0, -np.pi / 2, 0.0, 0.0),
    (0.0, np.pi / 2, 0.380, 0.0),
    (0.0, -np.pi / 2, 0.0, 0.0),
    (0.0, 0.0, 0.065, np.pi),
)
# ranges of the axes as the data sheet gives them; the toolboxes shift axes 2 and 3 by 10 degrees
IRB_140_LIMITS_DEG = ((-180, 180), (-90, 110), (-230, 50), (-200, 200), (-115, 115), (-400, 400))
IRB_140_SPEEDS_DEG = (200, 200, 260, 360, 360, 450)


def gt6a_like(
    scale: float = 1.0,
    T_flange_sensor: Float[AnyArray, "4 4"] | None = None,
    T_world_base: Float[AnyArray, "4 4"] | None = None,
) -> Arm:
    """A six-axis industrial arm with a spherical wrist, like the thesis's GT6A, but not the GT6A.

    The dimensions of the GT6A of Fig. 4.13 were not found in print. These are those of the ABB IRB 140, an arm of the
    same build and use (six turning joints, reach 0.81 m to the wrist, 6 kg), in metres times ``scale``: give the
    scale that turns metres into your unit, or that makes the arm as long as yours. At zero the upper arm stands up,
    the forearm points ahead (x), and so does the flange's z. ``T_flange_sensor`` is in the scaled unit.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"arm: expected a positive scale, got {scale}.")
    rows = np.array(IRB_140_ROWS) * (scale, 1.0, scale, 1.0)
    limits, speeds = np.deg2rad(IRB_140_LIMITS_DEG), np.deg2rad(IRB_140_SPEEDS_DEG)
    return arm_from_dh(rows, limits, None, T_flange_sensor, T_world_base, speeds)
