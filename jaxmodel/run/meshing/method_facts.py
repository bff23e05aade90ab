"""What thesis Table 3.1 says of the methods of meshing, measured: openings, closedness, concavities, vertices, time.

Three clouds whose true surface is known: a ball (closed), the half of one (open) and a cup with a deep hollow.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxmodel.mesh.ball_pivoting import ball_pivoting
from jaxmodel.mesh.deformable import deform
from jaxmodel.mesh.distance import distance_to_points, to_surface
from jaxmodel.mesh.marching_cubes import marching_cubes
from jaxmodel.mesh.poisson import poisson
from jaxmodel.mesh.quality import quality
from jaxmodel.mesh.radii import cloud_scale
from jaxmodel.scan.triangle_mesh import ObjectMesh, icosphere, lathe

Mesher = Callable[[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], int], ObjectMesh]

METHODS: dict[str, Mesher] = {
    "ball-pivoting": lambda points, normals, order: ball_pivoting(points, normals).mesh,
    "deformable": lambda points, normals, order: deform(points, order).mesh,
    "marching-cubes": lambda points, normals, order: marching_cubes(points, normals),
    "poisson": lambda points, normals, order: poisson(points, normals),
}
NEAR = 2.0
"""Within how many spacings of a point the surface counts as followed."""
FAR = 3.0
"""Beyond how many spacings from every measured point a piece of surface was invented."""
_HOLLOW, _DEPTH, _RIM = 0.28, 0.9, 0.45
_SAMPLES = 20_000


def method_facts(method: str, points: int, order: int, seed: int) -> dict[str, Any]:
    """All facts of one method on clouds of ``points``; ``order`` is that of the deformable surface.

    ``opening`` border loops on the open half ball, ``invented`` share of area that no measured point is near to;
    ``closed`` on the ball; ``hollow`` share of the points in the cup's hollow that the mesh comes near to;
    ``own_vertices`` share of the vertices that are points of the cloud; ``error`` mean distance of the points from the
    mesh in spacings; ``density`` triangles per area where the cloud is four times as dense over the rest, as a ratio.
    """
    make, random = METHODS[method], np.random.default_rng(seed)
    ball = icosphere(5)
    make(*_sampled(icosphere(3), 500, random), order)  # compiles what is to be compiled
    cloud, normals = _sampled(ball, points, random)
    begun = time.perf_counter()
    whole = make(cloud, normals, order)
    seconds = time.perf_counter() - begun
    on_ball = quality(whole)
    upper = ball.vertices[ball.faces].mean(axis=1)[:, 2] > 0
    half, half_normals = _sampled(ObjectMesh(ball.vertices, ball.faces[upper]), points // 2, random)
    open_mesh = make(half, half_normals, order)
    probes, _ = _sampled(open_mesh, _SAMPLES, random)
    spacing = cloud_scale(half).spacing
    cup, cup_normals = _sampled(_cup(), points, random)
    made_cup = make(cup, cup_normals, order)
    inner = (np.hypot(*cup[:, :2].T) < 1.01 * _HOLLOW) & (cup[:, 2] < _DEPTH)
    reached = to_surface(cup[inner], made_cup)
    uneven, uneven_normals = _sampled(ball, points, random, dense_above=0.0)
    return {
        "method": method,
        "points": points,
        "opening": quality(open_mesh).border_loops,
        "invented": float((distance_to_points(probes, half) > FAR * spacing).mean()),
        "closed": on_ball.closed,
        "border_loops": on_ball.border_loops,
        "hollow": float((reached < NEAR * cloud_scale(cup).spacing).mean()),
        "own_vertices": float((distance_to_points(whole.vertices, cloud) < 1e-9).mean()),
        "error": float(to_surface(cloud, whole).mean() / cloud_scale(cloud).spacing),
        "density": _density(make(uneven, uneven_normals, order)),
        "triangles": len(whole.faces),
        "seconds": seconds,
    }


def _cup() -> ObjectMesh:
    """A cup with a hollow of radius 0.28, 0.8 deep; closed."""
    return lathe([(0, 0), (_RIM, 0), (_RIM, 1), (_HOLLOW, 1), (_HOLLOW, 0.2), (0, 0.2)], 64)


def _sampled(
    mesh: ObjectMesh, count: int, random: np.random.Generator, dense_above: float | None = None
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points spread by area, and their triangles' normals; four times as dense where z is above ``dense_above``."""
    corners = np.asarray(mesh.vertices, np.float64)[mesh.faces]
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(vectors, axis=1)
    weight = doubled if dense_above is None else doubled * np.where(corners[:, :, 2].mean(axis=1) > dense_above, 4, 1)
    row = random.choice(len(corners), count, p=weight / weight.sum())
    u, v = np.sort(random.random((2, count)), axis=0)
    shares = np.stack([u, v - u, 1 - v], axis=1)
    return np.einsum("nk,nka->na", shares, corners[row]), vectors[row] / doubled[row, None]


def _density(mesh: ObjectMesh) -> float:
    """Triangles per area above z = 0, over those below."""
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    above = corners[:, :, 2].mean(axis=1) > 0
    return float((above.sum() / area[above].sum()) / ((~above).sum() / area[~above].sum()))
