"""What the pictures of a scene need, kept in the run's folder: the views and the mesh, each triangle with a colour."""

import io
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8

from jaxmodel.io.results import RunDir


class Drawn(NamedTuple):
    """A mesh with the colours of its triangles; without triangles its points are drawn, in their colours."""

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    colours: UInt8[np.ndarray, "k 3"]


def keep(folder: RunDir, name: str, **meshes: Drawn) -> None:
    """Write the meshes under a name each into ``drawn/NAME.npz``."""
    buffer = io.BytesIO()
    arrays = {
        f"{key}_{field}": np.asarray(value, np.float32) if field == "vertices" else value
        for key, mesh in meshes.items()
        for field, value in mesh._asdict().items()
    }
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    folder.write(f"drawn/{name}.npz", buffer.getvalue())


def kept(folder: RunDir, name: str) -> dict[str, Drawn]:
    """What ``keep`` wrote."""
    with np.load(folder.path / "drawn" / f"{name}.npz", allow_pickle=False) as arrays:
        names = dict.fromkeys(key.rsplit("_", 1)[0] for key in arrays.files)
        return {name: Drawn(*(arrays[f"{name}_{field}"] for field in Drawn._fields)) for name in names}
