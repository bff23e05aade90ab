"""Hand-eye calibration AX = XB (RR-3507): solvers, what the motions determine, self-calibration, uncertainty."""

from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.solve import Calibration, Calibrations, solve, solve_many

__all__ = ["Calibration", "Calibrations", "Outcome", "solve", "solve_many"]
