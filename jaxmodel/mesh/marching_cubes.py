"""Marching cubes over the signed distance of oriented points: the volumetric comparator (thesis §3.2.2, Table 3.1)."""

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.mesh.prepare import prepare
from jaxmodel.mesh.radii import cloud_scale
from jaxmodel.mesh.signed_distance import grid_of, signed_distance
from jaxmodel.scan.triangle_mesh import ObjectMesh

CELLS_PER_SPACING = 2.0
MOST_NODES = 200_000_000


def marching_cubes(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"] | None,
    cell: float | Literal["auto"] = "auto",
    reach_cells: float = 3.0,
) -> ObjectMesh:
    """A mesh of uniform detail; open where no point is within ``reach_cells`` cells.

    Args:
        points, normals: the cloud; normals point outwards, and are estimated where none are given.
        cell: edge of a voxel in the cloud's unit; ``auto`` is twice the cloud's spacing.
        reach_cells: how far from the points the distance is known; below sqrt(3) every cube has an unknown node.

    Raises:
        InputError: an unusable cloud (see ``orient``), a cell that is not positive or so small that the grid would not
            fit, or so large that no surface is left.
    """
    cloud = prepare(points, normals)
    points = cloud.points
    edge = CELLS_PER_SPACING * cloud_scale(points, cloud.tree).spacing if cell == "auto" else float(cell)
    if not (np.isfinite(edge) and edge > 0):
        raise InputError(f"cell is {cell}, expected a positive length.")
    size = float(np.ptp(points, axis=0).max())
    if np.prod(np.ceil(np.ptp(points, axis=0) / edge) + 6) > MOST_NODES:
        least = float((np.prod(np.maximum(np.ptp(points, axis=0), 1e-3 * size)) / MOST_NODES) ** (1 / 3))
        raise InputError(f"cell is {edge:g}: the grid would have more than {MOST_NODES} nodes; {least:.3g} would do.")
    from skimage import measure

    field = signed_distance(cloud, grid_of(points, edge), reach_cells * edge)
    try:
        vertices, faces, _, _ = measure.marching_cubes(field.value, 0.0, mask=_whole_cubes(field.known))
    except (ValueError, RuntimeError) as error:
        raise InputError(f"No surface crosses a grid of cell {edge:g}: expected a smaller cell ({error}).") from None
    return ObjectMesh(field.grid.origin + (vertices + 0.5) * edge, faces.astype(np.int64))


def _whole_cubes(known: Bool[np.ndarray, "i j k"]) -> Bool[np.ndarray, "i j k"]:
    """The cubes all of whose eight corners are known, at the place where skimage asks: their far corner."""
    whole = np.zeros_like(known)
    whole[1:, 1:, 1:] = np.lib.stride_tricks.sliding_window_view(known, (2, 2, 2)).all(axis=(3, 4, 5))
    return whole
