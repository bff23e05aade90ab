"""A cloud made ready for meshing: points checked, normals checked and on one side."""

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.mesh.orientation import Oriented, orient
from jaxmodel.scan.cloud import check_points


def checked_cloud(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"] | None
) -> tuple[Float[np.ndarray, "n 3"], Oriented]:
    """The points in float64 and their normals. Raises ``InputError``: see ``check_points`` and ``orient``; a line."""
    points = check_points(points).astype(np.float64)
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-6 * spread[0]:
        raise InputError(f"All {len(points)} points lie on one line: there is no surface through them.")
    return points, orient(points, normals)
