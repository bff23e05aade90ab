"""The scenes of the experiment ``mesh_segments``: views of planes and solids as a sensor and a registration leave them.

Every scene is simulated, for the thesis's own data are not available: its sensor's noise, then a small error of each
view's pose, stand for acquisition and registration.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.scan.noise import Laser, Noise, Profilometer, Stereo
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.plane_scenes import PlaneScene, crossing_planes, one_plane
from jaxmodel.scan.polyhedron import nine_facets
from jaxmodel.scan.range_image import grid_triangles, to_cloud
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, join
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh, turntable_poses


class Errors(NamedTuple):
    """What the scenes suffer from. ``offset`` (spacings) and ``tilt_deg`` of the views of planes; ``pixels`` across
    the images of solids; ``registration`` of their views (standard deviation of each axis, share of the size; as much
    again by a turn at half the size), of cubes none.
    """

    offset: float
    tilt_deg: float
    pixels: int
    registration: float


class Scene(NamedTuple):
    """``views`` registered, with their local meshes (without triangles where the sensor gives none), and the normals
    of their points and homogeneous places of their sensor, None where the views have none of their own. ``noise`` is
    what is known of the scatter across the surface before it is meshed, None where the mesh has to tell; ``thinning``
    the distance left between points, None for the mesher's own choice. ``planes``, ``segments``: the true numbers.
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
    """Each plane is one sheet and goes whole through the other."""
    return _plane_views(crossing_planes(errors.offset, errors.tilt_deg, seed), errors, 1.0, 2)


_AWAY = 3.0  # sizes between a solid and its sensor
_FIELD_DEG = 28.0


def _nine_facets(errors: Errors, seed: int) -> Scene:
    """Nine views by a laser scanner, one onto each facet, as many as in the thesis."""
    mesh, _ = nine_facets(0)
    return _solid(mesh, 9, Laser(), errors, seed)


def _cube(sigma: float) -> Callable[[Errors, int], Scene]:
    """Fourteen views of a cube, onto its sides and its corners, half as many pixels across, in their true places."""

    def scene(errors: Errors, seed: int) -> Scene:
        mesh = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
        noise = Laser(sigma=sigma) if sigma else None
        half = errors._replace(registration=0.0, pixels=errors.pixels // 2)
        return _solid(mesh, 6, noise, half, seed)

    return scene


def _solid(mesh: ObjectMesh, planes: int, noise: Noise | None, errors: Errors, seed: int) -> Scene:
    """A convex solid from all sides: a view onto each of its planes, of a cube onto its corners too."""
    first, second, third = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    vectors = np.cross(second - first, third - first)
    normals = np.unique(np.round(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), 6), axis=0)
    poses = [look_at(_AWAY * normal, np.zeros(3)) for normal in normals]
    if len(normals) == 6:
        corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T / np.sqrt(3)
        poses += [look_at(_AWAY * corner, np.zeros(3)) for corner in corners]
    sensor = Sensor(width=errors.pixels, height=errors.pixels, field_of_view_deg=_FIELD_DEG)
    return _scanned(mesh, poses, sensor, noise, errors, seed, None, planes, planes)


def _stereo(errors: Errors, seed: int) -> Scene:
    """Two views of a floor and a board that leans on a chair, by a stereo bench (Fig. 5.5); lengths in metres.

    The planes counted are the floor and the board; seat, back and legs of the chair come on top where they are seen.
    """
    legs = [box((x, y, 0), (x + 0.04, y + 0.04, 0.43)) for x in (-0.22, 0.18) for y in (-0.22, 0.18)]
    chair = [*legs, box((-0.22, -0.22, 0.43), (0.22, 0.22, 0.47)), box((-0.22, 0.18, 0.47), (0.22, 0.22, 0.9))]
    lean, half = np.deg2rad(20), 0.3
    board = box((-half, -0.01, 0), (half, 0.01, 0.55))
    turn = Rotation.from_euler("x", -lean).as_matrix()
    board = ObjectMesh(board.vertices @ turn.T + np.array([0.0, -0.14, 0.475]), board.faces)
    floor = box((-1.2, -1.2, -0.02), (1.2, 1.2, 0.0))
    target = np.array([0.0, 0.0, 0.4])
    poses = [look_at(np.array([x, -2.0, 1.5]), target) for x in (-0.35, 0.35)]
    sensor = Sensor(width=2 * errors.pixels, height=3 * errors.pixels // 2, field_of_view_deg=50.0)
    noise = Stereo(sigma=0.0008, correlation_px=1.0, unit="data")
    made = _scanned(join(floor, board, *chair), poses, sensor, noise, errors, seed, None, 2, 2)
    return made._replace(noise=noise.sigma * float(np.linalg.norm(poses[0][:3, 3] - target)) ** 2)


def _torso(errors: Errors, seed: int) -> Scene:
    """A torso by the four cameras of a profilometer: rings of points, far apart upwards, without local meshes."""
    poses = list(turntable_poses([45, 135, 225, 315], _AWAY))
    sensor = Sensor(width=7 * errors.pixels // 2, height=7 * errors.pixels // 2, field_of_view_deg=_FIELD_DEG)
    perfect = errors._replace(registration=0.0)
    made = _scanned(object_mesh("torso"), poses, sensor, Profilometer(), perfect, seed, 2, 0, 1)
    return made._replace(views=[ObjectMesh(view.vertices, np.zeros((0, 3), np.int64)) for view in made.views])


def _two_tables(errors: Errors, seed: int) -> Scene:
    """Two table tops at one height with a gap between them, from above on both sides: two segments in one plane."""
    tops = [box((-1.0, -0.4, 0), (-0.1, 0.4, 0.03)), box((0.1, -0.4, 0), (1.0, 0.4, 0.03))]
    poses = [look_at(np.array([x, -1.0, 4.0]), np.zeros(3)) for x in (-1.0, 1.0)]
    sensor = Sensor(width=2 * errors.pixels, height=errors.pixels, field_of_view_deg=44.0)
    return _scanned(join(*tops), poses, sensor, Laser(), errors, seed, None, 1, 2)


def _scanned(
    mesh: ObjectMesh,
    poses: Sequence[Float[np.ndarray, "4 4"]],
    sensor: Sensor,
    noise: Noise | None,
    errors: Errors,
    seed: int,
    every_row: int | None,
    planes: int,
    segments: int,
) -> Scene:
    """The mesh scanned from all poses, each of which is a little off; of the images ``every_row``-th row alone."""
    import jax

    random, size = np.random.default_rng(seed), mesh.size()
    views, normals, eyes = [], [], []
    for number, pose in enumerate(poses):
        key = jax.random.fold_in(jax.random.key(seed), number)
        image = scan_mesh(mesh.vertices, mesh.faces, sensor, pose, noise, key)
        cloud, faces = to_cloud(image), grid_triangles(image)
        if every_row is not None:
            kept = np.nonzero(image.valid)[0] % every_row == 0
            cloud, faces = cloud.take(kept), np.zeros((0, 3), np.int64)
        if len(cloud) == 0 or cloud.normals is None:
            continue
        T_world_view = _registration(random, errors.registration, size) @ pose
        placed = cloud.moved(T_world_view)
        assert placed.normals is not None
        views.append(ObjectMesh(placed.points, faces))
        normals.append(placed.normals)
        eyes.append(T_world_view @ sensor.eye)
    return Scene(views, normals, eyes, None, None, planes, segments)


def _registration(random: np.random.Generator, share: float, size: float) -> Float[np.ndarray, "4 4"]:
    """A small rigid motion about the origin: ``share`` of the size along each axis, as much by a turn at half of it."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(2 * share * random.normal(size=3)).as_matrix()
    T[:3, 3] = share * size * random.normal(size=3)
    return T


def _nothing_given(make: Callable[[Errors, int], Scene]) -> Callable[[Errors, int], Scene]:
    """The scene with neither the thinning nor the noise given."""
    return lambda errors, seed: make(errors, seed)._replace(thinning=None, noise=None)


SCENES: dict[str, Callable[[Errors, int], Scene]] = {
    "one_plane": _one_plane,
    "crossing_planes": _crossing_planes,
    "one_plane_unaided": _nothing_given(_one_plane),
    "crossing_planes_unaided": _nothing_given(_crossing_planes),
    "nine_facets": _nine_facets,
    "stereo": _stereo,
    "torso": _torso,
    "two_tables": _two_tables,
    "cube": _cube(0.0),
    "noisy_cube": _cube(0.001),
}
