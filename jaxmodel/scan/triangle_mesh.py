"""A plain triangle mesh, and the closed solids the test objects are put together from."""

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

Number = float | int
Place = tuple[Number, Number, Number]


class ObjectMesh(eqx.Module):
    """A triangle mesh: ``vertices (n, 3)``, ``faces (m, 3)`` counter-clockwise seen from outside, in object units.

    It may hold several closed parts that overlap: seen from outside, the first hit of a ray is then the union's.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]

    def size(self) -> float:
        """The longest side of the bounding box."""
        return float(np.ptp(self.vertices, axis=0).max())


def join(*parts: ObjectMesh) -> ObjectMesh:
    """The parts side by side in one mesh; they are not cut against each other."""
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    return ObjectMesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
    )


def unit_sized(mesh: ObjectMesh) -> ObjectMesh:
    """``mesh`` with its bounding box centred on the origin and the box's longest side 1."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return ObjectMesh(vertices=(mesh.vertices - (low + high) / 2) / (high - low).max(), faces=mesh.faces)


def upright(mesh: ObjectMesh, up: Literal["x", "y", "z"]) -> ObjectMesh:
    """``mesh`` turned by whole quarters so that its axis ``up`` becomes z."""
    order = {"x": [1, 2, 0], "y": [2, 0, 1], "z": [0, 1, 2]}[up]
    return ObjectMesh(vertices=mesh.vertices[:, order], faces=mesh.faces)


def placed(mesh: ObjectMesh, z_axis: Place, origin: Place) -> ObjectMesh:
    """``mesh`` turned so that its z axis points along ``z_axis``, then moved to ``origin``."""
    z = np.array(z_axis) / np.linalg.norm(z_axis)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z], axis=1)
    return ObjectMesh(vertices=mesh.vertices @ R.T + np.array(origin), faces=mesh.faces)


def box(low: Place, high: Place, cells: int = 1) -> ObjectMesh:
    """An axis-aligned box whose faces are cut into ``cells x cells`` squares, one closed surface."""
    lattice: dict[tuple[int, int, int], int] = {}
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for level in (0, cells):
            for i in range(cells):
                for j in range(cells):
                    corner = np.zeros((4, 3), dtype=np.int64)
                    corner[:, axis] = level
                    corner[:, u] = (i, i + 1, i + 1, i)
                    corner[:, v] = (j, j, j + 1, j + 1)
                    a, b, c, d = (lattice.setdefault((p[0], p[1], p[2]), len(lattice)) for p in corner.tolist())
                    faces += [(a, b, c), (a, c, d)] if level else [(a, c, b), (a, d, c)]
    unit = np.array(list(lattice), dtype=np.float64) / cells
    return ObjectMesh(vertices=np.array(low) + unit * (np.array(high) - np.array(low)), faces=np.array(faces))


def lathe(profile: Sequence[tuple[Number, Number]], segments: int = 48) -> ObjectMesh:
    """The solid swept by turning a profile of (radius, height) around z; sphere topology.

    ``profile`` runs from a point on the axis (radius 0) to another, the outside on its right hand when radius
    points right and height up: bottom first, outer wall upwards.
    """
    radius, height = np.array(profile, dtype=np.float64).T
    angle = np.arange(segments) * (2 * np.pi / segments)
    rings = np.stack(
        [
            radius[1:-1, None] * np.cos(angle),
            radius[1:-1, None] * np.sin(angle),
            np.repeat(height[1:-1, None], segments, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    start, end = len(rings), len(rings) + 1
    vertices = np.concatenate([rings, [[0.0, 0.0, height[0]], [0.0, 0.0, height[-1]]]])
    here = np.arange(segments)
    after = (here + 1) % segments
    last = (len(radius) - 3) * segments
    faces = [np.stack([np.full(segments, start), after, here], axis=1)]
    for ring in range(len(radius) - 3):
        low, high = ring * segments, (ring + 1) * segments
        faces.append(np.stack([low + here, low + after, high + after], axis=1))
        faces.append(np.stack([low + here, high + after, high + here], axis=1))
    faces.append(np.stack([np.full(segments, end), last + here, last + after], axis=1))
    return ObjectMesh(vertices=vertices, faces=np.concatenate(faces))


def ring(major: Number, minor: Number, segments: int = 48, sides: int = 16) -> ObjectMesh:
    """A torus around z: tube radius ``minor``, its centre line at radius ``major``."""
    u, v = (np.arange(n) * (2 * np.pi / n) for n in (segments, sides))
    u, v = np.meshgrid(u, v, indexing="ij")
    reach = major + minor * np.cos(v)
    vertices = np.stack([reach * np.cos(u), reach * np.sin(u), minor * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(segments), np.arange(sides), indexing="ij")
    a, b = i * sides + j, (i + 1) % segments * sides + j
    d, c = i * sides + (j + 1) % sides, (i + 1) % segments * sides + (j + 1) % sides
    faces = np.concatenate([np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)])
    return ObjectMesh(vertices=vertices, faces=faces)


def icosphere(subdivisions: int) -> ObjectMesh:
    """The unit sphere: an icosahedron subdivided, ``20 · 4^subdivisions`` triangles."""
    g = (1 + np.sqrt(5.0)) / 2
    signs = ((-1, g), (1, g), (-1, -g), (1, -g))
    vertices = np.array([(a, b, 0) for a, b in signs] + [(0, a, b) for a, b in signs] + [(b, 0, a) for a, b in signs])
    distance = np.linalg.norm(vertices[:, None] - vertices[None], axis=-1)
    near = (distance > 0.1) & (distance < 2.1)
    a, b, c = np.array(list(combinations(range(12), 3))).T
    faces = np.stack([a, b, c], axis=1)[near[a, b] & near[b, c] & near[a, c]]
    inward = np.einsum("ij,ij->i", np.cross(vertices[faces[:, 0]], vertices[faces[:, 1]]), vertices[faces[:, 2]]) < 0
    faces[inward] = faces[inward][:, ::-1]
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = vertices[unique].sum(axis=1)
        ab, bc, ca = (len(vertices) + inverse.reshape(-1, 3)).T
        a, b, c = faces.T
        vertices = np.concatenate([vertices, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return ObjectMesh(vertices=vertices, faces=faces)
