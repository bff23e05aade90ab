"""The thesis's two scenes of overlapping, misregistered views of planes (Figs 3.10, 3.11), as points and local meshes.

The captions and the text count the views differently; the numbers of points and triangles say four and six: each view
is a grid of 8 x 10 points, 80 points and 126 triangles. Lengths in spacings of that grid.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.scan.triangle_mesh import ObjectMesh

ROWS, COLUMNS = 8, 10
OVERLAP = 1.5
"""By how many spacings neighbouring views overlap."""


class PlaneScene(NamedTuple):
    """``points`` of all views with unit ``normals`` as each view has them, ``faces`` of the views' own meshes (three
    point numbers), and for each point its ``view`` and the ``plane`` it was seen on. ``T_world_view`` is the error of
    each view's registration: where its points lie against where they belong. ``planes`` are the true planes, a point
    and a unit normal each.
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    view: Int[np.ndarray, " n"]
    plane: Int[np.ndarray, " n"]
    T_world_view: Float[np.ndarray, "v 4 4"]
    planes: Float[np.ndarray, "k 2 3"]

    def mesh(self) -> ObjectMesh:
        """The views' own meshes side by side, not joined."""
        return ObjectMesh(vertices=self.points, faces=self.faces)


def one_plane(offset: float = 0.15, tilt_deg: float = 0.5, seed: int = 0) -> PlaneScene:
    """Fig. 3.10: four views of one plane, two by two, 320 points and 504 triangles.

    Each is off by a rigid motion drawn from ``seed``: up to ``offset`` spacings along each axis (``offset`` itself,
    up or down in turn, along the normal) and up to ``tilt_deg`` about any axis.
    """
    plane = np.array([[[0, 0, 0], [0, 0, 1.0]]])
    return _scene([(0, corner) for corner in _corners()], plane, offset, tilt_deg, seed)


def crossing_planes(offset: float = 0.15, tilt_deg: float = 0.5, seed: int = 0) -> PlaneScene:
    """Fig. 3.11: four views of one plane and a pair of another, at right angles through their middle; 480 points and
    756 triangles. Registration errors as in :func:`one_plane`.
    """
    width, depth = COLUMNS - 1, ROWS - 1
    middle = width - OVERLAP / 2
    placed = [(0, corner) for corner in _corners()]
    placed += [(1, (0.0, -width / 2)), (1, (depth - OVERLAP, -width / 2))]
    planes = np.array([[[0, 0, 0], [0, 0, 1.0]], [[middle, 0, 0], [1.0, 0, 0]]])
    return _scene(placed, planes, offset, tilt_deg, seed)


def _corners():
    """Lower corners of four views that overlap, in their plane."""
    width, depth = COLUMNS - 1 - OVERLAP, ROWS - 1 - OVERLAP
    return [(0.0, 0.0), (width, 0.0), (0.0, depth), (width, depth)]


def _scene(placed, planes, offset, tilt_deg, seed) -> PlaneScene:
    if not (np.isfinite(offset) and offset >= 0 and np.isfinite(tilt_deg) and tilt_deg >= 0):
        raise InputError(f"The views' offset and tilt must be zero or more, not {offset} and {tilt_deg}.")
    random = np.random.default_rng(seed)
    rows, columns = np.meshgrid(np.arange(ROWS), np.arange(COLUMNS), indexing="ij")
    first = (rows * COLUMNS + columns)[:-1, :-1].reshape(-1)
    lower = np.stack([first, first + 1, first + COLUMNS + 1], axis=1)
    upper = np.stack([first, first + COLUMNS + 1, first + COLUMNS], axis=1)
    points, normals, motions = [], [], []
    for number, (plane, corner) in enumerate(placed):
        row, column, level = rows.reshape(-1), columns.reshape(-1), np.zeros(ROWS * COLUMNS)
        along = (column, row, level) if plane == 0 else (level, row, column)
        exact = np.stack(along, axis=1) + np.insert(corner, 2 if plane == 0 else 0, planes[plane, 0].max())
        T = _error(random, planes[plane, 1], exact.mean(axis=0), offset * (-1) ** number, tilt_deg)
        points.append(exact @ T[:3, :3].T + T[:3, 3])
        normals.append(np.broadcast_to(T[:3, :3] @ planes[plane, 1], exact.shape))
        motions.append(T)
    count = len(placed)
    per_view = ROWS * COLUMNS
    return PlaneScene(
        points=np.concatenate(points),
        normals=np.concatenate(normals),
        faces=np.concatenate([np.concatenate([lower, upper]) + k * per_view for k in range(count)]),
        view=np.repeat(np.arange(count), per_view),
        plane=np.repeat([plane for plane, _ in placed], per_view),
        T_world_view=np.stack(motions),
        planes=planes,
    )


def _error(random, normal, centre, along_normal, tilt_deg):
    """A rigid motion: a turn about ``centre`` by at most ``tilt_deg``, a shift along and across the normal."""
    axis = random.normal(size=3)
    R = Rotation.from_rotvec(axis / np.linalg.norm(axis) * tilt_deg * random.uniform(-1, 1), degrees=True).as_matrix()
    shift = abs(along_normal) * random.uniform(-1, 1, size=3)
    shift = shift + (along_normal - shift @ normal) * normal
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = centre - R @ centre + shift
    return T
