"""Adaptive triangulation of a range image, from two triangles at the horizon (thesis §2.4.2; MISSION 1.3).

Prefer its vertices to those of ``decimate.py`` where contours are to be edges of the mesh: every vertex is a measured
point by construction, and no triangle covers a gap or a depth jump. At equal counts decimation approximates smooth
surfaces more closely, as it chooses places where splitting takes the middle of a triangle.
"""

from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.control_points.conforming_delaunay import check_segments
from jaxmodel.control_points.contour_segments import contour_segments
from jaxmodel.control_points.image_surfaces import Surfaces, as_range_image, surfaces_of
from jaxmodel.control_points.pixel_triangulation import HORIZON
from jaxmodel.control_points.triangle_splitting import (
    SplitOptions,
    Splitting,
    centres_of,
    reach_bound,
    reach_count,
    start,
)
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.range_image import RangeImage, Scan, to_sensor


class SplitMesh(eqx.Module):
    """A triangle mesh through measured points of a range image, sensor frame, unit of the data.

    ``vertices (v, 3)`` and the ``pixels (v, 2)``, row and column, they were measured at, in row-major order;
    ``triangles (f, 3)`` facing the sensor; ``error (f,)`` root mean square distance of each triangle's readings to
    their plane. ``bound``: the least :class:`SplitOptions` bound that every triangle holding a reading besides its
    vertices meets, removed ones included. ``noise``: estimated standard deviation of a reading. ``at_horizon``,
    ``too_sparse``, ``degenerate``: triangles taken out by the three filters. ``lost_segments``: pieces of the given
    segments that cross places without reading, where they are no edges.
    """

    vertices: Float[np.ndarray, "v 3"]
    pixels: Int[np.ndarray, "v 2"]
    triangles: Int[np.ndarray, "f 3"]
    error: Float[np.ndarray, " f"]
    bound: float
    noise: float
    at_horizon: int
    too_sparse: int
    degenerate: int
    lost_segments: int


def split_mesh(
    image: Scan,
    segments: Int[np.ndarray, "s 2 2"] | None = None,
    count: int | None = None,
    options: SplitOptions = SplitOptions(),
) -> SplitMesh:
    """Triangulate a range image as finely as its surfaces bend.

    Segments are inserted first and stay edges. Then each triangle whose readings are farther from their plane than
    its bound, or which reaches over an outline, is split at a reading, in rounds, the worst triangles first.

    Args:
        image: the range image, sensor frame.
        segments: pixels (row, column) of the ends of segments that are to be chains of edges; both have a reading.
        count: split until the mesh has so many vertices, whatever the bound: reached within 1 %, with segments that
            alone take more vertices exceeded, and missed where the image has no more readings on surfaces.
        options: the bound and other thresholds.

    Returns:
        The mesh; without any triangle where no surface is larger than a pixel or two.

    Raises:
        InputError: ``image`` is not a range image, has fewer than two rows or columns, no valid pixel or no two
            neighbouring ones; ``count`` is below 3; a segment's end is outside the image or has no reading.
    """
    image = as_range_image(image)
    surfaces = surfaces_of(image)
    pieces = check_segments(surfaces, segments)
    state = start(surfaces, pieces, options)
    if count is None:
        return _mesh(image, surfaces, reach_bound(surfaces, state, options))
    _check_count(count)
    return _mesh(image, surfaces, reach_count(surfaces, state, options, count, "vertices"))


def split_control_points(
    image: Scan, count: int, at: Literal["vertices", "centres"] = "vertices", contours: bool = True
) -> Cloud:
    """Control points of a range image from its split mesh.

    Args:
        image: the range image, sensor frame.
        count: how many points are wanted, at least 3; reached within 5 % where the image has so many.
        at: the mesh's vertices, or at the centre of each triangle the reading nearest to it in the image.
        contours: insert the image's contours (creases, both sides of depth jumps, borders) as edges; they take at
            most a third of the vertices at first. A surface without any goes on without.

    Returns:
        Cloud of distinct measured points in the sensor frame, in row-major order, with their normals and border flags.

    Raises:
        InputError: as :func:`split_mesh`, or the mesh has fewer than 3 points.
    """
    image = as_range_image(image)
    surfaces = surfaces_of(image)
    _check_count(count)
    measured = as_cloud(image, "the range image")
    options = SplitOptions()
    vertices = count if at == "vertices" else count // 2  # a triangulation has about two triangles a vertex
    pieces = check_segments(surfaces, contour_segments(image, surfaces, vertices // 3) if contours else None)
    state = reach_count(surfaces, start(surfaces, pieces, options), options, count, at)
    pixels = state.kept_vertices() if at == "vertices" else centres_of(surfaces, state)
    if len(pixels) < 3:
        raise InputError("the range image has no surface, expected neighbouring readings to make control points from")
    return measured.take((np.cumsum(image.valid.ravel()) - 1)[np.sort(pixels @ [image.valid.shape[1], 1])])


def _mesh(image: RangeImage, surfaces: Surfaces, state: Splitting) -> SplitMesh:
    """The kept triangles over their own vertices, in row-major order and facing the sensor."""
    kept = state.filtered.kept
    flat = state.mesh.pixels @ [surfaces.valid.shape[1], 1]
    used, renumbered = np.unique(flat[state.mesh.triangles[kept] - HORIZON], return_inverse=True)
    triangles = renumbered.reshape(-1, 3)
    pixels = np.stack(np.divmod(used, surfaces.valid.shape[1]), axis=1)
    vertices = surfaces.points[pixels[:, 0], pixels[:, 1]]
    corner = vertices[triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    if np.sum(normal * to_sensor(image, corner.mean(axis=1))) < 0:  # one sign for the whole image, as in the grid
        triangles = triangles[:, ::-1]
    return SplitMesh(
        vertices,
        pixels,
        triangles,
        state.fit.error[kept],
        float(state.score.max(initial=0.0)),
        surfaces.noise,
        state.filtered.horizon,
        state.filtered.density,
        state.filtered.shape,
        state.mesh.lost,
    )


def _check_count(count: int) -> None:
    if count < 3:
        raise InputError(f"count is {count}, expected at least 3 vertices")
