"""The scenes of the experiment ``mesh_segments``: views of planes and solids as a sensor and a registration leave them.

Every scene is simulated, for the thesis's own data are not available: its sensor's noise, then a small error of each
view's pose, stand for acquisition and registration.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.scan.noise import Laser, Noise, Profilometer, Stereo
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.plane_scenes import PlaneScene, crossing_planes, one_plane
from jaxmodel.scan.polyhedron import nine_facets
from jaxmodel.scan.range_image import grid_triangles, to_cloud
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, join
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh


class Errors(NamedTuple):
    """What the scenes suffer from. ``offset`` (spacings) and ``tilt_deg`` of the views of planes; ``pixels`` across
    the images of solids; ``registration`` of their views (standard deviation of each axis, share of the size; as much
    again by a turn at half the size).
    """

    offset: float
    tilt_deg: float
    pixels: int
    registration: float


class Scene(NamedTuple):
    """``views`` registered, with their local meshes (without triangles where the sensor gives none), and the normals
    of their points and homogeneous places of their sensor, None where the views have none of their own. ``noise`` is
    what is known of the scatter across the surface before it is meshed, None where the mesh has to tell; ``thinning``
    the distance left between points, None for the mesher's own choice. ``planes`` and ``segments`` are the true numbers.
    """

    views: list[ObjectMesh]
    normals: list[Float[np.ndarray, "n 3"]] | None
    eyes: list[Float[np.ndarray, "4"]] | None
    thinning: float | None
    noise: float | None
    planes: int
    segments: int


def make_scene(name: str, errors: Errors, seed: int) -> Scene:
    """The scene ``name``. Raises :class:`InputError` listing the names when there is none."""
    if name not in SCENES:
        raise InputError(f"scenes: there is no scene {name!r}; there are {', '.join(SCENES)}")
    return SCENES[name](errors, seed)


def _plane_views(scene: PlaneScene, errors: Errors, thinning: float, segments: int) -> Scene:
    per_view = len(scene.points) // len(scene.T_world_view)
    views = []
    for view in range(len(scene.T_world_view)):
        own = scene.view == view
        faces = scene.faces[scene.view[scene.faces[:, 0]] == view] - per_view * view
        views.append(ObjectMesh(scene.points[own], faces))
    return Scene(views, None, None, thinning, errors.offset or None, len(scene.planes), segments)


def _one_plane(errors: Errors, seed: int) -> Scene:
    return _plane_views(one_plane(errors.offset, errors.tilt_deg, seed), errors, 1.2, 1)


def _crossing_planes(errors: Errors, seed: int) -> Scene:
    """Each plane parts the other in two."""
    return _plane_views(crossing_planes(errors.offset, errors.tilt_deg, seed), errors, 1.0, 4)


SCENES: dict[str, Callable[[Errors, int], Scene]] = {
    "one_plane": _one_plane,
    "crossing_planes": _crossing_planes,
}
