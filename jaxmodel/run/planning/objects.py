"""The ten objects a modelling run is measured on: five built in, five from the data folder."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.io.datasets import data_root
from jaxmodel.io.meshes import load_mesh
from jaxmodel.mesh.adjacency import adjacency
from jaxmodel.scan.known_solids import stepped_block
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.triangle_mesh import ObjectMesh, unit_sized, upright

BUILT_IN: dict[str, Callable[[], ObjectMesh]] = {
    "y_pipe": lambda: object_mesh("y_pipe"),
    "valve": lambda: object_mesh("valve"),
    "block_curved": lambda: object_mesh("block_curved"),
    "gourd": lambda: object_mesh("gourd"),
    "stepped_block": stepped_block,
}
"""Two with deep concavities and parts before parts, a block with curved faces, a smooth one, one with valleys."""


class _File(NamedTuple):
    """Where an object lies in the data folder, and which axis of the file points up."""

    place: str
    up: Literal["x", "y", "z"]


FROM_FILES = {
    "bunny": _File("stanford_bunny/reconstruction/bun_zipper_res2.ply", "y"),
    "spot": _File("meshes/spot.obj", "y"),
    "suzanne": _File("meshes/suzanne.obj", "y"),
    "fandisk": _File("meshes/fandisk.obj", "z"),
    "wingnut": _File("meshes/wingnut.obj", "y"),
}
PLANNING_OBJECTS = (*BUILT_IN, *FROM_FILES)


class PlanningObject(NamedTuple):
    """An object to model: ``mesh`` upright along z, centred, its longest side 1; ``watertight`` says whether closed.

    Closed means that every edge of a triangle is met by as many triangles running against it as along it. An object
    that is open can be seen into, but only its outer sides count as seen.
    """

    name: str
    mesh: ObjectMesh
    watertight: bool


def planning_object(name: str) -> PlanningObject:
    """The object ``name`` of :data:`PLANNING_OBJECTS`.

    Raises :class:`InputError` for an unknown name, listing those there are, and for a file that the data folder
    lacks, saying where it was looked for.
    """
    if name in BUILT_IN:
        mesh = BUILT_IN[name]()
    elif name in FROM_FILES:
        mesh = _from_file(name)
    else:
        raise InputError(f"There is no object {name!r} to plan views for; there are {', '.join(PLANNING_OBJECTS)}.")
    return PlanningObject(name, mesh, is_watertight(mesh))


def load_object(name: str) -> ObjectMesh:
    """The mesh of an object of :data:`PLANNING_OBJECTS`, or of a mesh file of that name, as it lies in the file."""
    if name in PLANNING_OBJECTS:
        return planning_object(name).mesh
    try:
        mesh = load_mesh(name)
    except InputError:
        if "." in name or "/" in name:
            raise
        raise InputError(
            f"objects: there is no object {name!r} and no file of that name; there are {', '.join(PLANNING_OBJECTS)}"
        ) from None
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{name}: a vertex is not finite, so it cannot be scanned.")
    return mesh


def object_files(names: Iterable[str]) -> list[Path]:
    """The files that objects come from: those of the data folder, and names that are files themselves."""
    root = data_root()
    found = [root / FROM_FILES[name].place for name in names if name in FROM_FILES and root is not None]
    return [*found, *(Path(name) for name in names if name not in PLANNING_OBJECTS)]


def is_watertight(mesh: ObjectMesh) -> bool:
    """Whether the triangles close: vertices at one place count as one, faces without area do not count."""
    _, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = place.reshape(-1)[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    along = np.where(faces < faces[:, [1, 2, 0]], 1, -1)
    return len(faces) > 0 and not np.bincount(adjacency(faces).edge_of.ravel(), weights=along.ravel()).any()


def _from_file(name: str) -> ObjectMesh:
    place, up = FROM_FILES[name]
    root = data_root()
    if root is None:
        raise InputError(f"The object {name!r} needs the data folder: set JAXMODEL_DATA to the one that holds {place}.")
    if not (root / place).is_file():
        raise InputError(f"The object {name!r} needs the file {place}, which the data folder {root} does not hold.")
    mesh = load_mesh(root / place)
    used, faces = np.unique(mesh.faces, return_inverse=True)  # stray vertices would count in the size
    return unit_sized(upright(ObjectMesh(mesh.vertices[used], faces.reshape(-1, 3)), up))
