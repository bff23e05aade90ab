"""Hand-eye calibration AX = XB (RR-3507): solvers, what the motions determine, self-calibration, uncertainty.

``solve`` and ``solve_many`` take pairs of motions; ``calibrate_poses`` takes absolute poses and names its answers by
their frames; ``self_calibrate`` has camera translations of unknown scale.
"""

from jaxmodel.calibrate.motions import Setup, chain, excitation, motion_pairs
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.poses import HandEye, calibrate_poses, joint_many
from jaxmodel.calibrate.self_calibration import Scales, SelfCalibration, self_calibrate
from jaxmodel.calibrate.solve import Calibration, Calibrations, solve, solve_many

__all__ = [
    "Calibration",
    "Calibrations",
    "HandEye",
    "Outcome",
    "Scales",
    "SelfCalibration",
    "Setup",
    "calibrate_poses",
    "chain",
    "excitation",
    "joint_many",
    "motion_pairs",
    "self_calibrate",
    "solve",
    "solve_many",
]
