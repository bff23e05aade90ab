"""Motions and poses as users give them: checked, each defect named by its row, and made exactly orthonormal."""

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError

TOLERANCE = 1e-3  # files print as few as 4 digits; anything further off is no rotation


def checked_motions(motions: object, name: str) -> Float[np.ndarray, "n 4 4"]:
    """``motions`` as float64 ``(n, 4, 4)`` with orthonormal rotations.

    Raises :class:`InputError` naming the first row (from 0) that is not a rigid motion, and its defect.
    """
    try:
        T = np.array(motions, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise InputError(f"{name}: expected 4 x 4 matrices of numbers, (n, 4, 4).") from error
    if T.size == 0:
        return np.zeros((0, 4, 4))
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise InputError(f"{name}: expected 4 x 4 matrices, (n, 4, 4), not an array of shape {T.shape}.")
    finite = np.isfinite(T).all(axis=(1, 2))
    if not finite.all():
        raise InputError(f"{name}, row {int(np.argmin(finite))}: holds a value that is not a finite number.")
    found = first_defect(T)
    if found is not None:
        raise InputError(f"{name}, row {found[0]}: expected a rigid motion; {found[1]}.")
    T[:, 3] = [0.0, 0.0, 0.0, 1.0]
    R = T[:, :3, :3]
    if np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max() > 1e-14:
        U, _, Vt = np.linalg.svd(R)
        T[:, :3, :3] = U @ Vt
    return T


def first_defect(T: Float[np.ndarray, "n 4 4"]) -> tuple[int, str] | None:
    """The first row of finite matrices that is no rigid motion, and what is wrong with it in words."""
    R = T[:, :3, :3]
    defect = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2))
    determinant = np.linalg.det(R)
    last = np.abs(T[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1)
    for row in np.flatnonzero((defect > TOLERANCE) | (determinant < 0) | (last > TOLERANCE)).tolist():
        if last[row] > TOLERANCE:
            return row, f"its last row is {T[row, 3].tolist()} and not 0 0 0 1"
        if determinant[row] < 0 and defect[row] <= TOLERANCE:
            return row, "it is a reflection (determinant -1)"
        return row, f"R'R is off the identity by {defect[row]:.3g}, determinant {determinant[row]:.3g}"
    return None
