"""The true edges that a sensor sees: what an edge detector is measured against.

Sharp edges come from the mesh alone, by geometry of its own: no range image and no ray caster takes part. Depth jumps
come from an image without noise.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.scan.range_image import JUMP, RangeImage
from jaxmodel.scan.sensor import Sensor, project
from jaxmodel.scan.triangle_mesh import ObjectMesh

_CLEAR = 1e-6  # share of a point's distance within which a hit is the point itself


class VisibleEdges(eqx.Module):
    """Samples along the visible sharp edges of a mesh.

    ``pixels (k, 2)`` column and row, not rounded; ``angle_deg (k,)`` between the normals of the two faces, positive
    where the edge is convex; ``crease (k,)`` both faces are turned to the sensor, otherwise the edge is a silhouette.
    """

    pixels: Float[np.ndarray, "k 2"]
    angle_deg: Float[np.ndarray, " k"]
    crease: Bool[np.ndarray, " k"]


def visible_edges(
    mesh: ObjectMesh,
    sensor: Sensor,
    T_world_sensor: Float[np.ndarray, "4 4"],
    least_deg: float = 30.0,
    spacing_px: float = 0.25,
) -> VisibleEdges:
    """Samples, about ``spacing_px`` apart, of the edges between faces whose normals differ by ``least_deg`` or more.

    ``mesh`` is closed, or several closed parts that do not cut each other; world frame. A sample counts when at least
    one of its faces is turned to the sensor, nothing stands before it and it falls inside the image.
    """
    R, t = T_world_sensor[:3, :3], T_world_sensor[:3, 3]
    vertices = (mesh.vertices - t) @ R
    corners = vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges, faces = _pairs(mesh.faces)
    first, second = normals[faces[:, 0]], normals[faces[:, 1]]
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    angle = np.rad2deg(np.arctan2(sine, np.sum(first * second, axis=1)))
    middle = corners.mean(axis=1)
    bulge = np.sum(first * (middle[faces[:, 1]] - middle[faces[:, 0]]), axis=1)
    angle *= np.where(bulge < 0, 1.0, -1.0)
    sharp = np.abs(angle) >= least_deg
    edges, faces, angle = edges[sharp], faces[sharp], angle[sharp]
    ends = project(sensor, vertices)[edges]
    count = np.ceil(np.nan_to_num(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)) / spacing_px).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(edges)), count)
    share = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[edge]
    start, end = vertices[edges[edge, 0]], vertices[edges[edge, 1]]
    points = start + share[:, None] * (end - start)
    rays = _away(sensor, points)
    turned = np.sum(normals[faces[edge]] * rays[:, None], axis=2) < 0
    pixels = project(sensor, points)
    inside = ((pixels >= -0.5) & (pixels <= np.array([sensor.width, sensor.height]) - 0.5)).all(axis=1)
    seen = np.flatnonzero(inside & turned.any(axis=1))
    # of a closed part, what is hidden at all is hidden by a face turned to the sensor
    front = np.sum(normals * _away(sensor, middle), axis=1) < 0
    seen = seen[~_hidden(points[seen], rays[seen], sensor, corners[front])]
    return VisibleEdges(pixels[seen], angle[edge[seen]], turned[seen, 0] & turned[seen, 1])


def jump_pixels(clean: RangeImage, pitch: float, jump: float = JUMP, bridge: int = 2) -> Bool[np.ndarray, "h w"]:
    """Readings of an image without noise on either side of a depth jump along their row or column.

    ``pitch`` is the step between neighbouring rays, radian or (parallel rays) unit of the data. A jump parts readings
    whose distances differ by more than ``jump`` pitches, at most ``bridge`` missing readings between them.
    """
    if clean.eye[3] == 0:
        distance = -clean.points @ clean.eye[:3] / np.linalg.norm(clean.eye[:3])
    else:
        distance = np.linalg.norm(clean.points - clean.eye[:3] / clean.eye[3], axis=-1)
    out = np.zeros(distance.shape, dtype=bool)
    for axis in (0, 1):
        lines, marks = np.swapaxes(distance, 0, 1 - axis), np.swapaxes(out, 0, 1 - axis)
        for gap in range(1, bridge + 2):
            first, second = lines[:, :-gap], lines[:, gap:]
            reach = np.minimum(first, second) if clean.eye[3] != 0 else 1.0
            apart = np.abs(second - first) > jump * pitch * reach * np.sqrt(gap)  # NaN compares False
            for k in range(1, gap):
                apart &= np.isnan(lines[:, k : k - gap])
            marks[:, :-gap] |= apart
            marks[:, gap:] |= apart
    return out


def _pairs(faces: Int[np.ndarray, "m 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "e 2"]]:
    """The edges two faces share, and those faces."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((owner, sides[:, 1], sides[:, 0]))
    sides, owner = sides[order], owner[order]
    twin = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1))
    return sides[twin], np.stack([owner[twin], owner[twin + 1]], axis=1)


def _away(sensor: Sensor, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """Unit directions of the rays through points of the sensor frame."""
    away = sensor.eye[3] * points - sensor.eye[:3]
    return away / np.linalg.norm(away, axis=1, keepdims=True)


def _hidden(
    points: Float[np.ndarray, "k 3"],
    rays: Float[np.ndarray, "k 3"],
    sensor: Sensor,
    corners: Float[np.ndarray, "m 3 3"],
) -> Bool[np.ndarray, " k"]:
    """Whether a triangle stands between each point and the sensor (Möller and Trumbore 1997, all against all)."""
    out = np.zeros(len(points), dtype=bool)
    side, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    for rows in np.array_split(np.arange(len(points)), max(1, len(points) * len(corners) // 100_000)):
        ray = -rays[rows][:, None]
        cross = np.cross(ray, other)
        volume = np.sum(side * cross, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = points[rows][:, None] - corners[:, 0]
            u = np.sum(offset * cross, axis=-1) / volume
            turned = np.cross(offset, side)
            v = np.sum(ray * turned, axis=-1) / volume
            distance = np.sum(other * turned, axis=-1) / volume
            reach = np.linalg.norm(points[rows], axis=1)[:, None]
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > _CLEAR * reach)
            if sensor.eye[3] != 0:
                hit &= distance < reach
        out[rows] = hit.any(axis=1)
    return out
