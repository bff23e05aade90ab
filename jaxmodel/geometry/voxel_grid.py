"""A regular grid of cubic cells: the thesis's "clusters" and "voxel map" (thesis §2.5.1).

Registration, meshing and view planning share it. Keys are flat, row-major: ``(i * ny + j) * nz + k``.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int


class VoxelGrid(eqx.Module):
    """``origin`` is the corner of cell (0, 0, 0), ``cell`` the edge of a cell, both in the unit of the data."""

    origin: Float[np.ndarray, "3"]
    cell: float
    shape: tuple[int, int, int] = eqx.field(static=True)

    def __check_init__(self) -> None:
        if not self.cell > 0:
            raise ValueError(f"the cell edge of a voxel grid must be positive, not {self.cell}")
        if min(self.shape) < 1:
            raise ValueError(f"a voxel grid needs at least one cell along each axis, not {self.shape}")

    def indices(self, points: Float[np.ndarray, "*batch 3"]) -> Int[np.ndarray, "*batch 3"]:
        """Cell (i, j, k) of each point; may lie outside the grid (see ``inside``)."""
        return np.floor((points - self.origin) / self.cell).astype(np.int64)

    def inside(self, indices: Int[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
        """Whether a cell exists."""
        return np.asarray(np.all((indices >= 0) & (indices < np.asarray(self.shape)), axis=-1))

    def keys(self, indices: Int[np.ndarray, "*batch 3"]) -> Int[np.ndarray, "*batch"]:
        """Flat key of each cell, for cells inside the grid."""
        _, ny, nz = self.shape
        return np.asarray((indices[..., 0] * ny + indices[..., 1]) * nz + indices[..., 2])

    def centres(self, keys: Int[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 3"]:
        """Centre of each cell, given its key."""
        _, ny, nz = self.shape
        indices = np.stack([keys // (ny * nz), keys // nz % ny, keys % nz], axis=-1)
        return self.origin + (indices + 0.5) * self.cell


def cube_around(points: Float[np.ndarray, "n 3"], cells: int, margin: float) -> VoxelGrid:
    """A cube of ``cells`` per edge around the cloud's box grown by ``margin`` on every side (unit of the data)."""
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    edge = float((high - low).max())
    if not edge > 0:
        raise ValueError("a grid around points that all coincide needs a margin above zero")
    return VoxelGrid((low + high) / 2 - edge / 2, edge / cells, (cells, cells, cells))
