"""A mesh to turn in the report, triangles in their colours; a large one is drawn coarser, and says so."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8

MOST_TRIANGLES = 50_000
_PLAIN = "#9db4c8"
_COARSER = 1.15


class MeshView(NamedTuple):
    """``colours`` of the triangles, None for one colour; drawn with at most ``most`` triangles."""

    name: str
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    colours: UInt8[np.ndarray, "m 3"] | None = None
    most: int = MOST_TRIANGLES


def mesh_plot(view: MeshView) -> dict[str, Any]:
    """The mesh as a plain plotly tree of at most ``view.most`` triangles."""
    vertices, faces, kept = coarser(view.vertices, view.faces, view.most)
    drawn = f"drawn with {len(faces)} of its {len(view.faces)} triangles, corners merged"
    title = f"{view.name}, {drawn if len(faces) < len(view.faces) else f'{len(faces)} triangles'}"
    centred = vertices - vertices.mean(axis=0)
    digits = max(0, 5 - int(np.floor(np.log10(max(np.abs(centred).max(), 1e-300)))))
    x, y, z = (np.round(axis, digits).tolist() for axis in centred.T)
    i, j, k = faces.T.tolist()
    trace: dict[str, Any] = {
        "type": "mesh3d", "x": x, "y": y, "z": z, "i": i, "j": j, "k": k, "flatshading": True, "hoverinfo": "skip",
        "lighting": {"ambient": 0.45, "diffuse": 0.7, "specular": 0.1},
    }  # fmt: skip
    if view.colours is None:
        trace["color"] = _PLAIN
    else:
        trace["facecolor"] = [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in view.colours[kept].tolist()]
    hidden = {f"{axis}axis": {"visible": False} for axis in "xyz"}
    layout = {
        "title": {"text": title, "font": {"size": 14}},
        "margin": {"l": 0, "r": 0, "t": 40, "b": 0},
        "scene": {"aspectmode": "data", **hidden},
    }
    return {"data": [trace], "layout": layout}


def coarser(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], most: int
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "f 3"], Int[np.ndarray, " f"]]:
    """The mesh with the vertices of each cube of a grid merged, the grid as coarse as ``most`` triangles ask for.

    Returns vertices, triangles and the row of the input each triangle was. A small mesh comes back as it is.
    """
    if len(faces) <= most:
        return vertices, faces, np.arange(len(faces))
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    size = float(np.ptp(vertices, axis=0).max())
    cell = max(float(np.sqrt(area / most)), 1e-6 * size)
    while True:
        _, cube = np.unique(np.floor((vertices - vertices.min(axis=0)) / cell), axis=0, return_inverse=True)
        cube = cube.reshape(-1)
        merged = cube[faces]
        whole = np.flatnonzero(
            (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
        )
        _, first = np.unique(np.sort(merged[whole], axis=1), axis=0, return_index=True)
        kept = whole[np.sort(first)]
        if len(kept) <= most:
            break
        cell *= _COARSER
    count = np.bincount(cube)
    means = np.stack([np.bincount(cube, vertices[:, axis]) / count for axis in range(3)], axis=1)
    return means, merged[kept], kept
