"""Which points of a mesh's surface a range sensor sees from given poses (Open3D ray casting, CPU)."""

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.errors import InputError
from jaxmodel.scan.sensor import Sensor, project

LIFT = 1e-5
"""Share of the mesh's size that a ray leaves out at its start, so that it does not meet the triangle it starts on.

At the steepest grazing angle of interest it is still ten times above the rounding of the float32 ray caster.
"""
OBLIQUE = np.array([(0.6137, 0.5351, 0.5806), (-0.4409, 0.7577, -0.4811), (0.3312, -0.2159, -0.9185)])
"""Directions along no axis and no diagonal, for counting crossings."""


class Occluders:
    """A mesh prepared for occlusion tests: ``vertices (n, 3)`` and ``faces (m, 3)``, any unit and any origin.

    Casting is done in a frame centred on the mesh and scaled to its size, from the surface towards the sensor, so
    float32 loses nothing to a far origin or a far sensor. Raises :class:`InputError` for an empty mesh or a vertex
    that is not finite.
    """

    def __init__(self, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> None:
        if len(faces) == 0 or len(vertices) == 0:
            raise InputError("The mesh to look at has no faces.")
        used = np.asarray(vertices, dtype=np.float64)[np.unique(faces)]
        if not np.isfinite(used).all():
            raise InputError("The mesh to look at has a vertex that is not finite.")
        import open3d

        low, high = used.min(axis=0), used.max(axis=0)
        self.centre = (low + high) / 2
        self.size = float((high - low).max())
        if not self.size > 0:
            raise InputError("The mesh to look at has no extent.")
        corner = np.asarray(vertices, dtype=np.float64)[faces]
        self._normals = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        self._tensor = open3d.core.Tensor
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray((vertices - self.centre) / self.size, dtype=np.float32)),
            self._tensor(np.ascontiguousarray(faces, dtype=np.uint32)),
        )

    def between(
        self,
        points: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        distances: Float[np.ndarray, " n"],
    ) -> Bool[np.ndarray, " n"]:
        """Whether a triangle, seen from either side, lies on the way from a point along a unit direction.

        The way is ``distances`` long, in the unit of the mesh, and starts just off the point.
        """
        rays = np.concatenate([(points - self.centre) / self.size, directions], axis=1).astype(np.float32)
        reach = distances / self.size
        blocked = np.zeros(len(rays), dtype=bool)
        # Beyond the longest diagonal of the box, sqrt(3), there is nothing left to meet: such a ray may run on, and
        # any hit decides. A ray that ends earlier, at a sensor close by or inside, is decided by its first hit.
        far, near = np.flatnonzero(reach >= 2.0), np.flatnonzero(reach < 2.0)
        if len(far):
            blocked[far] = self._scene.test_occlusions(self._tensor(rays[far]), tnear=LIFT).numpy()
        if len(near):
            lifted = rays[near]
            lifted[:, :3] += np.float32(LIFT) * lifted[:, 3:]
            first = self._scene.cast_rays(self._tensor(lifted))["t_hit"].numpy()
            blocked[near] = first < reach[near] - 2 * LIFT
        return blocked

    def winding_numbers(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """How many closed parts of the mesh, facing outwards, each point lies in; a part facing inwards counts -1.

        Triangles crossed on the way out less those crossed on the way in, along three fixed directions of which the
        middle count stands, so that a ray through an edge does no harm. Meaningless where the mesh is open.
        """
        counts = []
        for direction in OBLIQUE:
            rays = np.empty((len(points), 6), dtype=np.float32)
            rays[:, :3], rays[:, 3:] = (points - self.centre) / self.size, direction
            hits = self._scene.list_intersections(self._tensor(rays))
            way_out = np.sign(self._normals[hits["primitive_ids"].numpy().astype(np.int64)] @ direction)
            counts.append(np.bincount(hits["ray_ids"].numpy(), weights=way_out, minlength=len(points)))
        return np.median(counts, axis=0).astype(np.int64)


def exposed_points(
    points_world: Float[np.ndarray, "n 3"], normals_world: Float[np.ndarray, "n 3"], occluders: Occluders
) -> Bool[np.ndarray, " n"]:
    """Which surface points border the outside of a mesh put together from closed parts that overlap.

    The others lie inside another part: no surface of the object. Meaningless where the mesh is open.
    """
    off = 10 * LIFT * occluders.size
    return occluders.winding_numbers(points_world + off * normals_world) == 0


def seen_points(
    points_world: Float[np.ndarray, "n 3"],
    normals_world: Float[np.ndarray, "n 3"],
    occluders: Occluders,
    sensor: Sensor,
    T_world_sensor: Float[np.ndarray, "4 4"],
    grazing_deg: float | int = 80.0,
) -> Bool[np.ndarray, " n"]:
    """Which surface points, with unit outward normals, a sensor at one pose sees.

    Seen is a point that falls inside the image, lies within the sensor's range limits (distance along its ray),
    turns its outer side to the sensor at an incidence below ``grazing_deg`` (angle between normal and ray; back
    faces never count), and has no triangle of ``occluders`` before it. Each such point lies on some pixel's
    square, but no pixel's ray need hit it exactly. Raises :class:`InputError` unless 0 < ``grazing_deg`` <= 90.
    """
    if not 0 < grazing_deg <= 90:
        raise InputError(f"grazing_deg: expected above 0 and at most 90, got {grazing_deg}.")
    R, t = T_world_sensor[:3, :3], T_world_sensor[:3, 3]
    local = (points_world - t) @ R
    pixels = project(sensor, local)
    with np.errstate(invalid="ignore"):  # NaN pixels lie behind the sensor: no comparison holds
        image = (pixels >= -0.5) & (pixels <= np.array([sensor.width - 0.5, sensor.height - 0.5]))
    if sensor.projection == "pinhole":
        distances = np.linalg.norm(local, axis=1)
        towards = -local / np.where(distances > 0, distances, 1.0)[:, None]
    else:
        distances = local[:, 2]
        towards = np.broadcast_to(np.array([0.0, 0.0, -1.0]), local.shape)
    low = 0.0 if sensor.minimum_range is None else sensor.minimum_range
    high = np.inf if sensor.maximum_range is None else sensor.maximum_range
    cosine = np.einsum("na,na->n", normals_world @ R, towards)
    facing = cosine > np.cos(np.deg2rad(grazing_deg))
    seen = image.all(axis=1) & (distances >= low) & (distances <= high) & (distances > 0) & facing
    asked = np.flatnonzero(seen)
    seen[asked] = ~occluders.between(points_world[asked], towards[asked] @ R.T, distances[asked])
    return seen
