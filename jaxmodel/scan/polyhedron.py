"""Convex polyhedra by their facets' planes, and meshes cut finer without a change of shape."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import HalfspaceIntersection, QhullError

from jaxmodel.errors import InputError
from jaxmodel.scan.triangle_mesh import ObjectMesh, unit_sized


def polyhedron(
    normals: Float[np.ndarray, "f 3"], distances: Float[np.ndarray, " f"]
) -> tuple[ObjectMesh, Int[np.ndarray, " m"]]:
    """The points on the inner side of planes with unit outward ``normals``, at ``distances`` from the origin inside;
    and the plane of each triangle. Raises ``InputError`` where the planes close nothing in.
    """
    if (distances <= 0).any():
        raise InputError("The planes of a polyhedron must leave the origin inside: all distances above zero.")
    try:
        with np.errstate(divide="ignore", invalid="ignore"):
            corners = HalfspaceIntersection(np.column_stack([normals, -distances]), np.zeros(3)).intersections
    except QhullError:  # fewer than four planes, or all through one line
        corners = np.full((1, 3), np.inf)
    if not np.isfinite(corners).all():
        raise InputError("The planes do not close a polyhedron in: some side of it is open.")
    size = np.ptp(corners, axis=0).max()
    first = np.unique(np.round(corners / size, 9), axis=0, return_index=True)[1]
    corners = corners[first]
    faces, plane = [], []
    for number, (normal, distance) in enumerate(zip(normals, distances, strict=True)):
        on = np.flatnonzero(np.abs(corners @ normal - distance) < 1e-9 * size)
        local = corners[on] - corners[on].mean(axis=0)
        u = local[0] / np.linalg.norm(local[0])
        on = on[np.argsort(np.arctan2(local @ np.cross(normal, u), local @ u))]
        faces += [(on[0], on[k], on[k + 1]) for k in range(1, len(on) - 1)]
        plane += [number] * (len(on) - 2)
    return ObjectMesh(vertices=corners, faces=np.array(faces)), np.array(plane)


def nine_facets(times: int = 5) -> tuple[ObjectMesh, Int[np.ndarray, " m"]]:
    """A convex polyhedron of nine facets, longest side 1, cut finer ``times`` times, and the facet of each triangle.

    The facets face along a spiral from pole to pole, all in different directions and at different distances.
    """
    step = np.arange(9) + 0.5
    height, angle = 1 - 2 * step / 9, np.pi * (1 + np.sqrt(5)) * step
    reach = np.sqrt(1 - height**2)
    normals = np.stack([reach * np.cos(angle), reach * np.sin(angle), height], axis=1)
    mesh, plane = polyhedron(normals, 1 + 0.12 * np.cos(2.0 * step))
    return subdivided(unit_sized(mesh), times), np.repeat(plane, 4**times)


def subdivided(mesh: ObjectMesh, times: int = 1) -> ObjectMesh:
    """Every triangle cut into four at the middles of its sides, ``times`` times; the four follow each other."""
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(times):
        sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        key, inverse = np.unique(sides[:, 0] * np.int64(len(vertices)) + sides[:, 1], return_inverse=True)
        ab, bc, ca = (len(vertices) + inverse.reshape(-1, 3)).T
        a, b, c = faces.T
        vertices = np.concatenate(
            [vertices, vertices[np.stack([key // len(vertices), key % len(vertices)])].mean(axis=0)]
        )
        faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return ObjectMesh(vertices=vertices, faces=faces)
