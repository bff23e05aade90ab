"""Meshes side by side as PNG, triangles in their colours, shaded by a light beside the eye."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.figure import Figure

from jaxmodel.view.figures import png_bytes
from jaxmodel.view.mesh_view import coarser

MOST_DRAWN = 12_000
_WIDE, _HIGH, _TITLE = 5.0, 4.4, 0.4
_AMBIENT = 0.55


class MeshPanel(NamedTuple):
    """One drawing, seen from ``elevation_deg`` above and ``azimuth_deg`` around z. Without ``faces`` points are drawn.

    ``colours`` of the triangles, else of the points.
    """

    title: str
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    colours: UInt8[np.ndarray, "k 3"]
    elevation_deg: float = 25.0
    azimuth_deg: float = -60.0


def mesh_png(panels: list[MeshPanel]) -> bytes:
    """All panels in one row, each with axes of equal scale that are not drawn."""
    across, up = _WIDE * len(panels), _HIGH + _TITLE
    figure = Figure(figsize=(across, up))
    figure.subplots_adjust(0, 0, 1, _HIGH / up, 0, 0)
    for number, panel in enumerate(panels):
        axes: Any = figure.add_subplot(1, len(panels), number + 1, projection="3d")
        _draw(axes, panel)
    return png_bytes(figure)


def _draw(axes: Any, panel: MeshPanel) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if len(panel.faces):
        vertices, faces, rows = coarser(panel.vertices, panel.faces, MOST_DRAWN)
        corners, colours = vertices[faces], panel.colours[rows] / 255
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        light = _AMBIENT + (1 - _AMBIENT) * np.abs(normal @ _towards(panel))
        edge = (0.2, 0.2, 0.2, 0.5) if len(faces) <= MOST_DRAWN / 4 else "none"
        shaded = colours * light[:, None]
        axes.add_collection3d(
            Poly3DCollection(corners, facecolors=shaded, edgecolors=edge, linewidths=0.25, antialiased=edge != "none")
        )
    else:
        vertices = panel.vertices
        axes.scatter(*vertices.T, s=1.0, c=panel.colours / 255, depthshade=False)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    side = np.maximum(high - low, 1e-3 * (high - low).max())
    middle = (low + high) / 2
    axes.set(**{f"{axis}lim": (middle[k] - side[k] / 2, middle[k] + side[k] / 2) for k, axis in enumerate("xyz")})
    axes.set_box_aspect(side / side.max(), zoom=1.1)
    axes.view_init(panel.elevation_deg, panel.azimuth_deg)
    axes.set_axis_off()
    axes.set_title(panel.title, fontsize=10)


def _towards(panel: MeshPanel) -> Float[np.ndarray, "3"]:
    """Direction to the light, 20 degrees beside and above the eye."""
    up, around = np.deg2rad([panel.elevation_deg + 20, panel.azimuth_deg + 20])
    return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
