"""A floor plan drawn up to a closed inner surface: floor, walls, columns, ceiling and a dome in it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import Delaunay, KDTree

from jaxmodel.scan.triangle_mesh import ObjectMesh

Circle = tuple[tuple[float, float], float, int]
"""Centre (x, y), radius, and the number of sides of the polygon, its corners on the circle."""


class Plan(NamedTuple):
    """Free space seen from above: inside ``outline (k, 2)``, counter-clockwise, and outside ``columns``.

    ``dome`` is a circle cut out of the ceiling. Circles keep clear of the outline and of each other.
    """

    outline: Float[np.ndarray, "k 2"]
    columns: list[Circle]
    dome: Circle


def drawn_up(plan: Plan, height: float, rise: float) -> ObjectMesh:
    """The closed inner surface of the plan between floor (z = 0) and ceiling, every triangle facing the free space.

    The dome is a spherical cap that rises ``rise`` over the ceiling.
    """
    loops = [plan.outline, *(_polygon(circle)[::-1] for circle in plan.columns)]  # free space on the left of each
    rim = _polygon(plan.dome)
    loops = _cut_up(loops, _spacing([*loops, rim]))
    rim = _cut_up([rim], np.inf)[0]
    wall = np.concatenate(loops)
    flat = np.concatenate([wall, rim])
    floor = _free_triangles(wall, loops)
    ceiling = _free_triangles(flat, [*loops, rim[::-1]])
    below, above = len(wall), len(flat)
    vertices = [np.column_stack([wall, np.zeros(below)]), np.column_stack([flat, np.full(above, height)])]
    faces = [floor, below + ceiling[:, ::-1]]
    start = 0
    for loop in loops:
        here = start + np.arange(len(loop))
        after = start + (np.arange(len(loop)) + 1) % len(loop)
        start += len(loop)
        faces += [
            np.stack([here, below + after, after], axis=1),
            np.stack([here, below + here, below + after], axis=1),
        ]
    cap, cap_faces = _cap(plan.dome, height, rise)
    vertices.append(cap)
    renumbered = np.concatenate([below + len(wall) + np.arange(len(rim)), below + above + np.arange(len(cap))])
    faces.append(renumbered[cap_faces])
    return ObjectMesh(vertices=np.concatenate(vertices), faces=np.concatenate(faces))


def _polygon(circle: Circle) -> Float[np.ndarray, "k 2"]:
    """The corners of a circle's polygon, counter-clockwise."""
    (x, y), radius, sides = circle
    angle = np.arange(sides) * (2 * np.pi / sides)
    return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)


def _spacing(loops: list[Float[np.ndarray, "_ 2"]]) -> float:
    """A length of edges for which the circle on each edge as diameter holds no point of another loop or wall.

    The edges are then edges of the points' Delaunay triangulation (Gabriel's condition), which needs no constraint.
    """
    dense = [_resampled(loop, 400) for loop in loops]
    trees = [KDTree(points) for points in dense]
    gaps = [trees[i].query(dense[j])[0].min() for i in range(len(loops)) for j in range(i)]
    sides = np.linalg.norm(loops[0] - np.roll(loops[0], -1, axis=0), axis=1)
    return float(min([*gaps, sides.min()])) / 2


def _resampled(loop: Float[np.ndarray, "_ 2"], cuts: int) -> Float[np.ndarray, "_ 2"]:
    """Points along a closed loop, ``cuts`` to a side."""
    share = np.arange(cuts)[:, None, None] / cuts
    return ((1 - share) * loop + share * np.roll(loop, -1, axis=0)).reshape(-1, 2)


def _cut_up(loops: list[Float[np.ndarray, "_ 2"]], longest: float) -> list[Float[np.ndarray, "_ 2"]]:
    """The loops with each side cut into equal pieces of at most ``longest``."""
    cut = []
    for loop in loops:
        pieces = []
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            count = max(1, int(np.ceil(np.linalg.norm(b - a) / longest)))
            pieces.append(a + (b - a) * (np.arange(count) / count)[:, None])
        cut.append(np.concatenate(pieces))
    return cut


def _free_triangles(points: Float[np.ndarray, "n 2"], loops: list[Float[np.ndarray, "_ 2"]]) -> Int[np.ndarray, "m 3"]:
    """Delaunay triangles of ``points`` that lie in the free space, counter-clockwise seen from above."""
    triangles = Delaunay(points).simplices.astype(np.int64)
    corners = points[triangles]
    side, rise = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = side[:, 0] * rise[:, 1] - side[:, 1] * rise[:, 0] < 0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    middle = corners.mean(axis=1)
    odd = np.zeros(len(triangles), dtype=bool)
    for loop in loops:
        odd ^= _encloses(loop, middle)
    return triangles[odd]


def _encloses(loop: Float[np.ndarray, "_ 2"], points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Which points a closed loop goes round, by the parity of its crossings to their right."""
    (ax, ay), (bx, by) = loop.T[:, None, :], np.roll(loop, -1, axis=0).T[:, None, :]
    x, y = points[:, :1], points[:, 1:]
    spans = (ay > y) != (by > y)
    with np.errstate(divide="ignore", invalid="ignore"):  # level sides span nothing
        crossing = ax + (y - ay) * (bx - ax) / (by - ay)
    return (spans & (crossing > x)).sum(axis=1) % 2 == 1


def _cap(dome: Circle, height: float, rise: float) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """The dome above its rim: new vertices, and faces that number the rim's corners before them."""
    (x, y), radius, sides = dome
    sphere = (radius**2 + rise**2) / (2 * rise)
    opening = np.arctan2(radius, sphere - rise)
    rings = max(2, sides // 6)
    around = np.arange(sides) * (2 * np.pi / sides)
    vertices = []
    for step in range(1, rings):
        polar = opening * (1 - step / rings)
        width, top = sphere * np.sin(polar), height + rise - sphere * (1 - np.cos(polar))
        vertices.append(np.stack([x + width * np.cos(around), y + width * np.sin(around), np.full(sides, top)], axis=1))
    vertices.append(np.array([[x, y, height + rise]]))
    here = np.arange(sides)
    after = (here + 1) % sides
    faces = []
    for ring in range(rings - 1):
        low, high = ring * sides, (ring + 1) * sides
        faces.append(np.stack([low + here, high + after, low + after], axis=1))
        faces.append(np.stack([low + here, high + here, high + after], axis=1))
    last = (rings - 1) * sides
    faces.append(np.stack([last + here, np.full(sides, last + sides), last + after], axis=1))
    return np.concatenate(vertices), np.concatenate(faces)
