"""A virtual range sensor: any mesh to range images from given poses (Open3D ray casting, CPU)."""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.scan.noise import Noise, with_noise
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, pixel_rays


def scan_mesh(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    sensor: Sensor,
    T_world_sensor: Float[np.ndarray, "4 4"],
    noise: Noise | None = None,
    key: jax.Array | None = None,
) -> RangeImage:
    """The range image a sensor at pose ``T_world_sensor`` takes of a mesh (world frame), in the sensor frame.

    The first surface along each ray counts, seen from either side. Without noise each point lies on its triangle's
    plane to float64 precision. Noise needs a ``key``; fractions in it are of the mesh's longest box side.
    Raises :class:`InputError` for an empty mesh, a non-finite vertex or noise without a key.
    """
    if len(faces) == 0 or len(vertices) == 0:
        raise InputError("The mesh to scan has no faces.")
    if not np.isfinite(vertices).all():
        raise InputError("The mesh to scan has a vertex that is not finite.")
    if noise is not None and key is None:
        raise InputError("Scanning with noise needs a random key.")
    import open3d

    # Casting is done in the sensor frame around the mesh, so float32 loses nothing to a far origin.
    R, t = T_world_sensor[:3, :3], T_world_sensor[:3, 3]
    local = (np.asarray(vertices, dtype=np.float64) - t) @ R
    rays = pixel_rays(sensor)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(np.ascontiguousarray(local, dtype=np.float32)),
        open3d.core.Tensor(np.ascontiguousarray(faces, dtype=np.uint32)),
    )
    cast = scene.cast_rays(
        open3d.core.Tensor(np.concatenate([rays.origins, rays.directions], axis=-1).astype(np.float32))
    )
    coarse = cast["t_hit"].numpy().astype(np.float64)
    hit = np.isfinite(coarse)
    corner = local[np.asarray(faces)[np.where(hit, cast["primitive_ids"].numpy(), 0).astype(np.int64)]]
    normal = np.cross(corner[..., 1, :] - corner[..., 0, :], corner[..., 2, :] - corner[..., 0, :])
    length = np.linalg.norm(normal, axis=-1)
    cosine = -np.sum(normal * rays.directions, axis=-1) / np.where(length > 0, length, 1.0)
    offset = np.sum(normal * (corner[..., 0, :] - rays.origins), axis=-1) / np.where(length > 0, length, 1.0)
    steep = np.abs(cosine) > 1e-4  # below that the plane says little about the distance: keep the cast one
    distance = np.where(steep, -offset / np.where(steep, cosine, 1.0), coarse)
    low = sensor.minimum_range if sensor.minimum_range is not None else 0.0
    high = sensor.maximum_range if sensor.maximum_range is not None else np.inf
    valid = hit & (distance > 0) & (distance >= low) & (distance <= high)
    distance = np.where(valid, distance, np.nan)
    image = RangeImage(rays.origins + distance[..., None] * rays.directions, valid, sensor.eye)
    if noise is None or key is None:
        return image
    size = float(np.ptp(np.asarray(vertices, dtype=np.float64)[np.unique(faces)], axis=0).max())
    return with_noise(key, image, cosine, noise, size)


def look_at(
    eye: Float[np.ndarray, "3"],
    target: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"] | None = None,
) -> Float[np.ndarray, "4 4"]:
    """``T_world_sensor`` of a sensor at ``eye`` looking at ``target`` (world), image rows running down.

    ``up`` is the world direction shown upwards, +z unless given; where it lies along the view, another axis
    stands in. Raises :class:`InputError` when eye and target coincide.
    """
    forward = np.asarray(target, dtype=np.float64) - eye
    length = float(np.linalg.norm(forward))
    if not length > 0:
        raise InputError("look_at: eye and target coincide, so there is no direction to look along.")
    forward = forward / length
    upward = np.array([0.0, 0.0, 1.0]) if up is None else np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    if np.linalg.norm(np.cross(forward, upward)) < 1e-6:
        upward = np.eye(3)[np.argmin(np.abs(forward))]
    right = np.cross(forward, upward)
    right /= np.linalg.norm(right)
    T_world_sensor = np.eye(4)
    T_world_sensor[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T_world_sensor[:3, 3] = eye
    return T_world_sensor


def turntable_poses(
    angles_deg: Sequence[float | int], distance: float | int, elevation_deg: float | int = 0.0
) -> Float[np.ndarray, "n 4 4"]:
    """``T_world_sensor`` of a sensor going around the world's z axis, looking at the origin from ``distance``.

    Angle 0 looks from +x, 90 from +y; ``elevation_deg`` lifts the sensor above the xy plane.
    """
    lift = np.deg2rad(elevation_deg)
    poses = []
    for angle in np.deg2rad(np.asarray(angles_deg, dtype=np.float64)):
        place = np.array([np.cos(lift) * np.cos(angle), np.cos(lift) * np.sin(angle), np.sin(lift)])
        poses.append(look_at(distance * place, np.zeros(3)))
    return np.stack(poses) if poses else np.zeros((0, 4, 4))
