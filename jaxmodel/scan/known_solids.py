"""Solids whose edges are known: what the detection of edges is measured on. Closed, centred, longest side 1."""

from collections.abc import Callable, Sequence

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.scan.triangle_mesh import Number, ObjectMesh, box, icosphere, join, lathe, unit_sized


def prism(profile: Sequence[tuple[Number, Number]], depth: Number) -> ObjectMesh:
    """The polygon ``profile`` of (x, z), counter-clockwise, drawn out along y from 0 to ``depth``.

    The first corner must see the whole polygon: its ends are fans around it.
    """
    x, z = np.array(profile, dtype=np.float64).T
    n = len(x)
    ends = [np.stack([x, np.full(n, y), z], axis=1) for y in (0.0, float(depth))]
    here = np.arange(n)
    after = (here + 1) % n
    fan = np.stack([np.zeros(n - 2, dtype=np.int64), here[1:-1], after[1:-1]], axis=1)
    sides = [np.stack([here, here + n, after + n], axis=1), np.stack([here, after + n, after], axis=1)]
    return ObjectMesh(vertices=np.concatenate(ends), faces=np.concatenate([fan, fan[:, ::-1] + n, *sides]))


def plain_box() -> ObjectMesh:
    """A box with sides 1, 0.7 and 0.5."""
    return unit_sized(box((0, 0, 0), (1, 0.7, 0.5)))


def stepped_block() -> ObjectMesh:
    """Four steps of different heights and widths, ridges and valleys in turn, all of 90 degrees."""
    stairs = [(0.8, 0.12), (0.8, 0.25), (0.55, 0.25), (0.55, 0.45), (0.3, 0.45), (0.3, 0.62)]
    return unit_sized(prism([(0, 0), (1, 0), (1, 0.12), *stairs, (0, 0.62)], 0.7))


def cylinder(segments: int = 96) -> ObjectMesh:
    """A cylinder of length 1 and diameter 0.75: its only edges are its two rims."""
    return unit_sized(lathe([(0, 0), (0.375, 0), (0.375, 1), (0, 1)], segments))


def roof(bend_deg: Number) -> ObjectMesh:
    """A house whose ridge bends by ``bend_deg`` (the angle between the normals of its two sides), along y."""
    height = 0.5 * float(np.tan(np.deg2rad(bend_deg) / 2))
    return unit_sized(prism([(0, 0), (1, 0), (1, 0.3), (0.5, 0.3 + height), (0, 0.3)], 1))


def ball() -> ObjectMesh:
    """A sphere of diameter 1 in facets of about one degree."""
    return unit_sized(icosphere(6))


def plate(size: Number = 20) -> ObjectMesh:
    """A flat square of side ``size`` with normal +z, wider than any view of it here."""
    half = 0.5 * float(size)
    corners = np.array([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)])
    return ObjectMesh(vertices=corners, faces=np.array([(0, 1, 2), (0, 2, 3)]))


def before_a_wall(mesh: ObjectMesh, gap: Number = 0.35) -> ObjectMesh:
    """``mesh`` with a wide slab ``gap`` below it, so that its outline, seen from above, is a depth jump."""
    below = float(mesh.vertices[:, 2].min()) - float(gap)
    return join(mesh, box((-6, -6, below - 0.1), (6, 6, below)))


KNOWN_SOLIDS: dict[str, Callable[[], ObjectMesh]] = {
    "box": plain_box,
    "stepped_block": stepped_block,
    "cylinder": cylinder,
    "roof30": lambda: roof(30.5),
    "roof45": lambda: roof(45),
    "roof60": lambda: roof(60),
    "ball": ball,
    "plate": plate,
}


def known_solid(name: str) -> ObjectMesh:
    """The solid ``name``. Raises :class:`InputError` listing the names when there is none."""
    if name not in KNOWN_SOLIDS:
        raise InputError(f"There is no solid {name!r}; there are {', '.join(KNOWN_SOLIDS)}.")
    return KNOWN_SOLIDS[name]()
