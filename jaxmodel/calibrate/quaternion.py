"""Horaud and Dornaika 1995 in closed form: the quaternion q with least ``sum w |q_A q - q q_B|^2``.

That is the rotation that best maps ``sin(angle / 2)`` times the B stream's axes on the A stream's: Park and Martin's
fit with other weights, which need no care near pi beyond the sign of each quaternion.
"""

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.linear import linear_rotation, linear_translation
from jaxmodel.calibrate.pairs import Pairs, align_signs, pair_sums, quaternions
from jaxmodel.calibrate.park import rotation_between


def solve_quaternion(pairs: Pairs, unknown_scale: bool = False) -> Estimate:
    """Rotation from the unit quaternions, signs by the linear solution, translation by least squares (eq. 3.14)."""
    sums = pair_sums(pairs)
    q_A = quaternions(pairs.R_A)
    q_B = align_signs(q_A, quaternions(pairs.R_B), linear_rotation(sums))
    return linear_translation(sums, rotation_between(q_A[:, 1:], q_B[:, 1:], pairs.weight), unknown_scale)
