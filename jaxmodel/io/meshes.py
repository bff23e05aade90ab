"""Triangle meshes from OBJ, STL and PLY files, vertices as the file has them."""

import logging
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.scan.objects import ObjectMesh

MESH_SUFFIXES = (".obj", ".ply", ".stl")


def load_mesh(path: str | Path) -> ObjectMesh:
    """The triangle mesh in a file, in its own frame and unit; larger polygons are split into triangles.

    Raises :class:`InputError` naming the file: absent, unknown extension, unreadable, no faces, or a face naming
    an absent or non-finite vertex.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{path}: unknown mesh extension {path.suffix!r}; known are {', '.join(MESH_SUFFIXES)}.")
    vertices, faces = _load(path)
    if len(faces) == 0:
        raise InputError(f"{path} has no faces: expected a mesh.")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: a face names vertex {int(faces.max())}, but there are {len(vertices)}.")
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise InputError(f"{path}: vertex {int(np.argmax(bad))} (counted from 0) is not finite.")
    return ObjectMesh(vertices=vertices, faces=faces)


def load_vertices(path: Path) -> Float[np.ndarray, "n 3"]:
    """The vertices of a mesh or point file, unmerged and in file order."""
    return _load(path)[0]


def _load(path: Path) -> tuple[np.ndarray, np.ndarray]:
    if not path.is_file():
        raise InputError(f"There is no file {path}.")
    import trimesh

    logger = logging.getLogger("trimesh")
    level = logger.level
    logger.setLevel(logging.ERROR)  # its warnings about damaged files would come before our sentence
    vertices: list[np.ndarray] = []
    faces = [np.zeros((0, 3), dtype=np.int64)]
    try:
        loaded = trimesh.load(path, process=False, maintain_order=True)
        for part in loaded.geometry.values() if isinstance(loaded, trimesh.Scene) else [loaded]:
            if isinstance(part, trimesh.Trimesh):
                faces.append(np.asarray(part.faces, dtype=np.int64).reshape(-1, 3) + sum(map(len, vertices)))
            if isinstance(part, trimesh.Trimesh | trimesh.PointCloud):
                vertices.append(np.asarray(part.vertices, dtype=np.float64).reshape(-1, 3))
    except Exception as error:  # trimesh raises whatever its parser meets: the file is the cause, and is named
        reason = str(error).rstrip(".")
        raise InputError(f"{path} is damaged or truncated, no readable {path.suffix[1:].upper()}: {reason}.") from error
    finally:
        logger.setLevel(level)
    if not vertices:
        raise InputError(f"{path} is damaged or truncated: it holds neither points nor a mesh.")
    return np.concatenate(vertices), np.concatenate(faces)
