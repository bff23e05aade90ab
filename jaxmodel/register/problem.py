"""A pair of clouds made ready for the kernels: validated, centred, padded, the target's voxel tables built."""

from typing import cast

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.masked import pad_rows, size_class
from jaxmodel.geometry.nearest import VoxelTable, build_table
from jaxmodel.register.method import IcpMethod
from jaxmodel.scan.cloud import Cloud, as_cloud, resolution
from jaxmodel.scan.estimate import estimate_borders, estimate_normals
from jaxmodel.scan.range_image import RangeImage


class Problem(eqx.Module):
    """What every start of a sweep shares. Clouds are float32 about ``*_centre``, structure of arrays, padded.

    ``size`` is the diagonal of the target's box, ``resolution`` its median spacing, ``box`` its low and high corner,
    ``reach`` the largest absolute coordinate of source and target.
    """

    source: Float[AnyArray, "3 n"]
    mask: Bool[AnyArray, " n"]
    count: Float[AnyArray, ""]
    target: Float[AnyArray, "3 m"]
    target_mask: Bool[AnyArray, " m"]
    normals: Float[AnyArray, "3 m"] | None
    border: Bool[AnyArray, " m"]
    box: Float[AnyArray, "2 3"]
    resolution: Float[AnyArray, ""]
    size: Float[AnyArray, ""]
    reach: Float[AnyArray, "2"]
    fast_table: VoxelTable | None
    exact_table: VoxelTable | None


class Frames(eqx.Module):
    """The centroids (float64, data frames) that the kernels' coordinates are relative to."""

    target_centre: Float[np.ndarray, "3"]
    source_centre: Float[np.ndarray, "3"]

    def to_centred(self, T_target_source: Float[np.ndarray, "s 4 4"]) -> tuple[np.ndarray, np.ndarray]:
        """Rotations and translations between the centred frames, float32."""
        R = T_target_source[:, :3, :3]
        t = R @ self.source_centre + T_target_source[:, :3, 3] - self.target_centre
        with np.errstate(over="ignore"):  # too far for float32: becomes infinite, and is reported as such
            return R.astype(np.float32), t.astype(np.float32)

    def from_centred(self, R: Float[np.ndarray, "s 3 3"], t: Float[np.ndarray, "s 3"]) -> Float[np.ndarray, "s 4 4"]:
        """Poses T_target_source in float64 from centred rotations (already orthonormal) and translations."""
        T = np.tile(np.eye(4), (len(R), 1, 1))
        T[:, :3, :3] = R
        T[:, :3, 3] = t.astype(np.float64) + self.target_centre - R @ self.source_centre
        return T


Views = Cloud | RangeImage | np.ndarray


def prepare(target: Views, source: Views, method: IcpMethod) -> tuple[Problem, Frames]:
    """Validate, centre, pad and index a pair. Raises ``InputError`` for clouds that cannot be registered.

    Normals and borders that the method needs and the target lacks are estimated from its points.
    """
    target_cloud, source_cloud = as_cloud(target, "the target"), as_cloud(source, "the source")
    target_points = np.asarray(target_cloud.points, np.float64)
    source_points = np.asarray(source_cloud.points, np.float64)
    frames = Frames(target_points.mean(axis=0), source_points.mean(axis=0))
    centred = target_points - frames.target_centre
    normals, border = target_cloud.normals, target_cloud.border
    if method.objective == "point_to_plane" and normals is None:
        normals = estimate_normals(centred)
    if method.border_filter and border is None:
        border = estimate_borders(centred)
    border = np.zeros(len(centred), bool) if border is None or not method.border_filter else border
    source_length, target_length = size_class(len(source_points)), size_class(len(centred))
    box = np.stack([centred.min(axis=0), centred.max(axis=0)])
    size = float(np.linalg.norm(box[1] - box[0]))

    def columns(points: np.ndarray, length: int) -> np.ndarray:
        return np.ascontiguousarray(pad_rows(points.astype(np.float32), length).T)

    margin = 0.2 * float(np.ptp(centred, axis=0).max())  # starts reach beyond the target's box
    exact = build_table(centred, method.exact_cells, method.candidates, margin) if method.needs_exact_table else None
    shared = exact is not None and method.cells == method.exact_cells  # one table then serves both
    fast = exact if shared else build_table(centred, method.cells, 1, margin) if method.needs_fast_table else None
    source_columns = columns(_in_spatial_order(source_points - frames.source_centre), source_length)
    problem = Problem(
        source=source_columns,
        mask=np.arange(source_length) < len(source_points),
        count=np.asarray(len(source_points), np.float32),
        target=columns(centred, target_length),
        target_mask=np.arange(target_length) < len(centred),
        normals=columns(cast(np.ndarray, normals), target_length) if method.objective == "point_to_plane" else None,
        border=pad_rows(np.asarray(border, bool), target_length),
        box=box.astype(np.float32),
        resolution=np.asarray(resolution(centred), np.float32),
        size=np.asarray(size, np.float32),
        reach=np.stack([np.abs(source_columns).max(), np.abs(box.astype(np.float32)).max()]),
        fast_table=fast,
        exact_table=exact,
    )
    return problem, frames


def _in_spatial_order(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Points along a Morton curve, so that neighbouring queries read neighbouring cells of the table."""
    low, edge = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), np.finfo(float).tiny)
    cells = ((points - low) / edge * 1023).astype(np.int64)
    key = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            key |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return points[np.argsort(key, kind="stable")]
