"""Files of H. Hoppe's surface reconstruction thesis (1994): points (lines ``p x y z``) and meshes of them."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.scan.triangle_mesh import ObjectMesh

_SKIPPED = ("#", "d", "g", "s")  # comments, density, noise and sampling notes


def read_hoppe(text: str, path: Path) -> Float[np.ndarray, "n 3"]:
    """The points of a ``.pts`` file; lines starting ``#``, ``d``, ``g``, ``s`` are ignored.

    Raises :class:`InputError` naming ``path`` and the line that is neither.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith(_SKIPPED):
            continue
        try:
            if words[0] != "p" or len(words) != 4:
                raise ValueError
            rows.append([float(word) for word in words[1:]])
        except ValueError:
            raise InputError(f"{path}, line {number}: expected 'p x y z', found {line[:60]!r}.") from None
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def read_hoppe_mesh(text: str, path: Path) -> ObjectMesh:
    """The mesh of a ``.m`` file: lines ``Vertex id x y z`` and ``Face id a b c``, braces after them left aside.

    Ids need not follow each other. Raises :class:`InputError` naming ``path`` and the line that is neither, or that
    names a vertex the file does not have.
    """
    row_of: dict[int, int] = {}
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("{")[0].split()
        if not words or words[0].startswith("#") or words[0] == "Edge":
            continue
        try:
            if words[0] not in ("Vertex", "Face") or len(words) != 5:
                raise ValueError
            if words[0] == "Vertex":
                row_of[int(words[1])] = len(vertices)
                vertices.append([float(word) for word in words[2:]])
            else:
                faces.append([row_of[int(word)] for word in words[2:]])
        except KeyError as missing:
            raise InputError(f"{path}, line {number}: there is no vertex {missing} before this face.") from None
        except ValueError:
            raise InputError(
                f"{path}, line {number}: expected 'Vertex id x y z' or 'Face id a b c', found {line[:60]!r}."
            ) from None
    return ObjectMesh(np.array(vertices, np.float64).reshape(-1, 3), np.array(faces, np.int64).reshape(-1, 3))
