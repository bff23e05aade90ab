"""How many different planes the flat segments of a mesh lie in: pieces of one plane count once."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxmodel.mesh.segmentation import Primitive
from jaxmodel.scan.triangle_mesh import ObjectMesh

WITHIN = 3.0
"""Distance up to which a piece belongs to another one's plane, in standard deviations of the noise."""
LEAST = 1e-3
"""... and at least this share of the mesh's size."""


def different_planes(mesh: ObjectMesh, segments: Sequence[Primitive], noise: float) -> int:
    """Planes among ``segments`` without those that go on in the plane of another: all of their corners lie within
    ``WITHIN`` of it in the mean, either way.
    """
    flat = [one for one in segments if one.kind == "plane"]
    if not flat:
        return 0
    bound = max(WITHIN * noise, LEAST * mesh.size())
    places = [mesh.vertices[np.unique(mesh.faces[one.faces])] for one in flat]
    away = np.array([[np.abs((of - plane.point) @ plane.direction).mean() for of in places] for plane in flat])
    same = np.maximum(away, away.T) < bound
    return int(connected_components(coo_matrix(same), directed=False, return_labels=False))
