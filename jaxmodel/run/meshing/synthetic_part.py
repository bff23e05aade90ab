"""Fig. 3.15 again: a part of a synthetic object, meshed by ball pivoting and by the deformable surface."""

from functools import cache

import numpy as np

from jaxmodel.mesh.ball_pivoting import ball_pivoting
from jaxmodel.mesh.deformable import deform
from jaxmodel.mesh.distance import sample_surface
from jaxmodel.mesh.quality import Quality, quality
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.triangle_mesh import ObjectMesh

OBJECT, ORDER, PART = "torso", 5, 380
"""``PART`` triangles of the ball make the part, as in the thesis."""
POINTS = 8927
"""Ball pivoting makes two triangles a point: 380 of them to 109 of the surface's 5120, as in the thesis."""


@cache
def synthetic_part() -> dict[str, Quality]:
    """The measures of both meshes where the object comes furthest out (largest x), over the same piece of it."""
    points = sample_surface(object_mesh(OBJECT), POINTS)
    meshes = {"ball": ball_pivoting(points).mesh, "deformable": deform(points, ORDER).mesh}
    tip = points[np.argmax(points[:, 0])]
    away = {name: np.linalg.norm(_middles(mesh) - tip, axis=1) for name, mesh in meshes.items()}
    reach = np.sort(away["ball"])[PART - 1]
    return {name: quality(ObjectMesh(mesh.vertices, mesh.faces[away[name] <= reach])) for name, mesh in meshes.items()}


def _middles(mesh: ObjectMesh) -> np.ndarray:
    return mesh.vertices[mesh.faces].mean(axis=1)
