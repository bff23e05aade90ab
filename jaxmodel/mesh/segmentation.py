"""A mesh cut into planes, cylinders, spheres and smooth free-form parts (thesis §3.3.2-3.3.3, MISSION 2.3).

The thesis segments while the ball pivots; here the finished mesh is segmented, which no order of pivoting can upset.
"""

from enum import Enum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import face_vectors
from jaxmodel.mesh.boundaries import REACH
from jaxmodel.mesh.labelling import label_faces
from jaxmodel.mesh.mesh_input import Frame, checked, joined, turned_alike
from jaxmodel.mesh.primitives import Kind, Surface, offset
from jaxmodel.mesh.snapping import snap
from jaxmodel.mesh.surface_noise import surface_noise
from jaxmodel.scan.triangle_mesh import ObjectMesh

FLAT = 5e-4
"""Scatter, in edge lengths, of a mesh without noise: what its file's digits and its makers' fits leave."""
SNAP = 0.5
"""How far snapping moves a vertex at most, in edge lengths, besides ``REACH`` standard deviations of the noise."""


class Outcome(Enum):
    """What became of the mesh; the value is a sentence."""

    PRIMITIVES = "every triangle belongs to a plane, a cylinder or a sphere"
    MIXED = "some triangles belong to planes, cylinders or spheres, the rest are smooth free-form parts"
    FREE_FORM = "no plane, cylinder or sphere was found: smooth free-form parts between creases"


class Primitive(NamedTuple):
    """One segment. ``point``, ``direction`` and ``radius`` as in :class:`Surface`; ``area`` its triangles';
    ``rms`` and ``largest`` distance of its vertices, as given, from the surface (NaN for free-form), those apart that
    are its only through triangles which bridge a crease; ``faces`` rows.
    """

    kind: Kind
    point: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    radius: float
    area: float
    rms: float
    largest: float
    faces: Int[np.ndarray, " k"]


class Segmentation(NamedTuple):
    """``labels`` number the segment of each triangle, ``primitives[label]`` says what it is, the largest area first.

    ``parts`` number the smooth face of each triangle: segments that meet without a crease, as a plane and the rounding
    of its edge, are one. ``mesh`` is the mesh given with the vertices between primitives moved to where these meet,
    each by at most ``snap_bound``; ``noise`` the standard deviation of its vertices across the surface. Lengths in the
    mesh's unit.
    """

    labels: Int[np.ndarray, " m"]
    parts: Int[np.ndarray, " m"]
    primitives: list[Primitive]
    mesh: ObjectMesh
    noise: float
    snap_bound: float
    outcome: Outcome

    def count(self, kind: Kind) -> int:
        """How many segments are of one kind."""
        return sum(primitive.kind == kind for primitive in self.primitives)


def segment(mesh: ObjectMesh, noise: float | None = None, snapping: bool = True) -> Segmentation:
    """Planes, cylinders, spheres and free-form parts of a mesh, each connected across edges of two triangles.

    All bounds come from the mesh: its edge length and the scatter of its vertices, estimated where ``noise`` (standard
    deviation across the surface, mesh unit) is not given. The order of triangles and of their corners does not matter;
    areas that lie in one plane but do not touch are two segments. Raises ``InputError`` for a mesh without triangles
    or area, corners that do not exist, coordinates that are no numbers, or a negative noise.
    """
    if noise is not None and not (np.isfinite(noise) and noise >= 0):
        raise InputError(f"The noise of a mesh is a length of zero or more, not {noise}.")
    inner, faces, frame = checked(mesh)
    order = np.lexsort(np.sort(faces, axis=1).T[::-1])
    vertices, faces, place, shared = joined(inner, faces[order])
    vectors = turned_alike(face_vectors(vertices, faces), shared)
    ends = vertices[shared.edges]
    edge = float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)))
    scatter = surface_noise(vertices, faces, shared) if noise is None else noise / frame.scale
    within = max(scatter, FLAT * edge)
    areas = np.linalg.norm(vectors, axis=1) / 2
    exact = scatter <= FLAT * edge
    label, surfaces, part, bridge = label_faces(vertices, faces, shared, vectors, within, edge, exact)
    label, surfaces, part = _by_area(label, surfaces, part, areas)
    bound = SNAP * edge + REACH * within
    moved = snap(vertices, faces, label, surfaces, bound) if snapping else vertices
    given = np.asarray(mesh.vertices, np.float64)
    placed = np.where((moved == vertices)[place], given, moved[place] * frame.scale + frame.centre)
    labels = np.empty(len(faces), np.int64)
    labels[order] = label
    return Segmentation(
        labels=labels,
        parts=part[labels],
        primitives=_primitives(label, surfaces, vertices, faces, areas, bridge, order, frame),
        mesh=ObjectMesh(placed, mesh.faces),
        noise=scatter * frame.scale,
        snap_bound=bound * frame.scale,
        outcome=_outcome(surfaces),
    )


def _by_area(label, surfaces, part, areas):
    """The segments, and the smooth faces they belong to, numbered by falling area."""
    rank = np.argsort(-np.bincount(label, areas, len(surfaces)), kind="stable")
    number = np.empty(len(rank), np.int64)
    number[rank] = np.arange(len(rank))
    label, part = number[label], part[rank]
    part_rank = np.argsort(-np.bincount(part[label], areas), kind="stable")
    return label, [surfaces[k] for k in rank], np.argsort(part_rank)[part]


def _primitives(label, surfaces: list[Surface], vertices, faces, areas, bridge, order, frame: Frame) -> list[Primitive]:
    """What is to be told of each segment, in the frame and unit of the mesh given."""
    by_label = np.argsort(label, kind="stable")
    ends = np.searchsorted(label[by_label], np.arange(len(surfaces) + 1))
    result = []
    for k, surface in enumerate(surfaces):
        rows = by_label[ends[k] : ends[k + 1]]
        rms = largest = float("nan")
        if surface.kind != "free-form":
            own = rows[~bridge[rows]]
            distance, _ = offset(surface, vertices[np.unique(faces[own if len(own) else rows])])
            rms, largest = float(np.sqrt(np.mean(distance**2))), float(np.abs(distance).max())
        result.append(
            Primitive(
                kind=surface.kind,
                point=surface.point * frame.scale + frame.centre,
                direction=surface.direction,
                radius=surface.radius * frame.scale,
                area=float(areas[rows].sum()) * frame.scale**2,
                rms=rms * frame.scale,
                largest=largest * frame.scale,
                faces=np.sort(order[rows]),
            )
        )
    return result


def _outcome(surfaces: list[Surface]) -> Outcome:
    free = sum(surface.kind == "free-form" for surface in surfaces)
    return Outcome.PRIMITIVES if free == 0 else Outcome.FREE_FORM if free == len(surfaces) else Outcome.MIXED
