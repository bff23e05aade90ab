"""A voxel map of what has been seen: six labels, points, nearest distance and normals (thesis §4.3.1).

A range image adds evidence: readings counted where they fall, voxels crossed on the way to them, voxels behind them.
Evidence is a union or a sum of whole numbers, so that views may come in any order, and labels follow from it.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

from jaxmodel.errors import InputError
from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.plan.labels import FACES, Label, derive_labels, neighbour

UNIT = 4096
"""Parts of 1 in which directions are summed: whole numbers have one sum whatever their order."""
NEAR = 0.15
"""Over which distance readings make it likelier that surface is near, in the map's longest edge."""
MOST = 2**31 // UNIT - 1
"""Readings of one voxel, or views behind which it lies, that these sums can hold."""


class LabelMap(eqx.Module):
    """Evidence on every voxel of ``grid`` (world frame, unit of the data).

    ``points`` readings in it; ``nearest`` distance from a sensor to one of them; ``normal_sum`` of their normals;
    ``crossed`` by a ray on its way to a reading, or known to be empty; ``behind`` in how many views it lay behind a
    reading, ``shadow_sum`` the products (xx xy xz yy yz zz) of the directions from which. ``outside`` readings that
    fell beyond the map, ``full`` readings not counted because their voxel holds the most it can. ``open_outside``:
    the space around the map is empty.
    """

    grid: VoxelGrid
    points: Int[np.ndarray, "x y z"]
    nearest: Float[np.ndarray, "x y z"]
    normal_sum: Int[np.ndarray, "x y z 3"]
    crossed: Bool[np.ndarray, "x y z"]
    behind: Int[np.ndarray, "x y z"]
    shadow_sum: Int[np.ndarray, "x y z 6"]
    outside: int
    full: int
    views: int
    open_outside: bool = eqx.field(static=True, default=True)

    @property
    def labels(self) -> Int[np.ndarray, "x y z"]:
        """The :class:`Label` of each voxel, int8."""
        return derive_labels(self.points > 0, self.crossed, self.behind > 0, self.open_outside)

    def share(self, label: Label) -> float:
        """Part of all voxels with one label."""
        return float(np.mean(self.labels == label))

    def normals(self, labels: Int[np.ndarray, "x y z"] | None = None) -> Float[np.ndarray, "x y z 3"]:
        """Unit normal of each voxel, float32, zero where none is known.

        Occupied and border voxels: mean of their points' normals. Occlusion planes: perpendicular to the rays that
        made them, towards their empty neighbours, all views taken together (thesis §4.3.1).
        """
        labels = self.labels if labels is None else labels
        plane = labels == Label.OCCLUSION_PLANE
        normal = np.where((self.points > 0)[..., None], self.normal_sum.astype(np.float64), 0.0)
        towards = np.zeros((*labels.shape, 3))
        empty = labels == Label.EMPTY
        for axis, direction in FACES:
            towards[..., axis] += direction * neighbour(empty, axis, direction, self.open_outside)
        e = towards[plane]
        xx, xy, xz, yy, yz, zz = self.shadow_sum[plane].T / UNIT
        along = np.stack([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        normal[plane] = self.behind[plane][:, None] * e - np.einsum("abn,nb->na", along, e)
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        # a mean shorter than the rounding of its directions has none
        least = np.where(plane, 2 / UNIT * self.behind, self.points)[..., None]
        return np.where(length > least, normal / np.maximum(length, 1e-300), 0.0).astype(np.float32)

    def near(self) -> Float[np.ndarray, "x y z"]:
        """exp(-d / L) of each voxel, d its distance from the nearest one that holds readings; 1 without readings.

        Surface goes on beside surface: an unseen voxel near some is likelier to hold more than one in the open. L is
        ``NEAR`` of the map's longest edge.
        """
        if not self.points.any():
            return np.ones(self.grid.shape, np.float32)
        away = np.asarray(distance_transform_edt(self.points == 0))
        return np.exp(-away / (NEAR * max(self.grid.shape))).astype(np.float32)

    def label_at(self, points_world: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Label of the voxel each point lies in; beyond the map EMPTY where that is open, else UNKNOWN."""
        index = self.grid.indices(points_world)
        there = self.grid.inside(index)
        label = np.full(len(index), Label.EMPTY if self.open_outside else Label.UNKNOWN, np.int8)
        label[there] = self.labels[tuple(index[there].T)]
        return label


def unknown_map(grid: VoxelGrid, open_outside: bool = False) -> LabelMap:
    """Nothing is known of any voxel: an environment before its first view."""
    shape = grid.shape
    return LabelMap(
        grid=grid,
        points=np.zeros(shape, np.int32),
        nearest=np.full(shape, np.inf, np.float32),
        normal_sum=np.zeros((*shape, 3), np.int32),
        crossed=np.zeros(shape, bool),
        behind=np.zeros(shape, np.int32),
        shadow_sum=np.zeros((*shape, 6), np.int32),
        outside=0,
        full=0,
        views=0,
        open_outside=open_outside,
    )


def object_map(centre: Float[np.ndarray, "3"], size: float, cells: int = 64, margin: float = 0.08) -> LabelMap:
    """A cube of ``cells`` an edge around an object that lies in a ball of diameter ``size`` (world, unit of the data).

    Only the ball is unknown, the rest empty (thesis §4.5); ``margin`` of the size lies around it. Raises
    :class:`InputError` where the voxels would be larger than the object.
    """
    if not (np.isfinite(size) and size > 0):
        raise InputError(f"The size of the object to map must be a positive length, not {size}.")
    if not np.isfinite(margin) or margin < 0:
        raise InputError(f"The margin around the object must be zero or more, in its size, not {margin}.")
    edge = size * (1 + 2 * margin)
    if cells < 1 or edge / cells > size:
        raise InputError(
            f"A map of {cells} voxels an edge has voxels larger than the object ({size:g}); take 8 or more."
        )
    centre = np.asarray(centre, np.float64)
    grid = VoxelGrid(centre - edge / 2, edge / cells, (cells, cells, cells))
    away = np.linalg.norm(grid.centres(np.arange(cells**3)).reshape(cells, cells, cells, 3) - centre, axis=-1)
    # a voxel that the ball touches may hold a part of the object
    known = away > size / 2 + grid.cell * np.sqrt(3) / 2
    return eqx.tree_at(lambda m: m.crossed, unknown_map(grid, open_outside=True), known)
