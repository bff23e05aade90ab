"""Planes, cylinders and spheres: distances, normals, and fits by least squares."""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

Kind = Literal["plane", "cylinder", "sphere", "free-form"]
STEPS = 8


class Surface(NamedTuple):
    """An unbounded surface. A plane: ``point`` on it, ``direction`` its unit normal. A cylinder: ``point`` on the axis,
    ``direction`` along it, ``radius``. A sphere: ``point`` its centre, ``radius``. What a kind lacks is NaN; free-form
    has neither.
    """

    kind: Kind
    point: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    radius: float


NOWHERE = np.full(3, np.nan)
FREE_FORM = Surface("free-form", NOWHERE, NOWHERE, float("nan"))


def offset(
    surface: Surface, points: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Signed distance of each point (positive outside, or ahead of a plane) and its gradient, the unit normal."""
    from_point = points - surface.point
    if surface.kind == "plane":
        return from_point @ surface.direction, np.broadcast_to(surface.direction, points.shape)
    if surface.kind == "cylinder":
        from_point = from_point - (from_point @ surface.direction)[:, None] * surface.direction
    length = np.sqrt(np.einsum("ij,ij->i", from_point, from_point))
    return length - surface.radius, from_point / np.maximum(length, 1e-300)[:, None]


def fit_plane(points: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"]) -> Surface:
    """The plane of least weighted squared distances."""
    share = weights / weights.sum()
    centre = share @ points
    centred = points - centre
    _, vectors = np.linalg.eigh((centred * share[:, None]).T @ centred)
    return Surface("plane", centre, vectors[:, 0], float("nan"))


def round_guesses(
    points: Float[np.ndarray, "s k 3"], normals: Float[np.ndarray, "s k 3"]
) -> tuple[list[Surface], list[Surface]]:
    """Spheres and cylinders through ``s`` neighbourhoods of points with normals, in closed form.

    On either, ``p = c + r n`` (for a cylinder across its axis, which no normal has a part along), so ``r`` is the slope
    of points over normals, both about their means.
    """
    mean_p, mean_n = points.mean(axis=1, keepdims=True), normals.mean(axis=1, keepdims=True)
    p, n = points - mean_p, normals - mean_n
    spread = np.maximum(np.einsum("ski,ski->s", n, n), 1e-300)
    radius = np.einsum("ski,ski->s", p, n) / spread
    centre = mean_p[:, 0] - radius[:, None] * mean_n[:, 0]
    axis = np.linalg.eigh(np.einsum("ski,skj->sij", normals, normals))[1][:, :, 0]
    across = p - np.einsum("ski,si->sk", p, axis)[..., None] * axis[:, None]
    bend = np.einsum("ski,ski->s", across, n) / spread
    on_axis = mean_p[:, 0] - bend[:, None] * mean_n[:, 0]
    spheres = [Surface("sphere", c, NOWHERE, abs(float(r))) for c, r in zip(centre, radius, strict=True)]
    cylinders = [Surface("cylinder", c, a, abs(float(r))) for c, a, r in zip(on_axis, axis, bend, strict=True)]
    return spheres, cylinders


def refine(
    surface: Surface, points: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"], steps: int = STEPS
) -> Surface:
    """The surface of the same kind with least weighted squared distances: Gauss-Newton from ``surface``."""
    if surface.kind == "plane":
        return fit_plane(points, weights)
    if surface.kind == "free-form":
        return surface
    for _ in range(steps):
        distance, normal = offset(surface, points)
        if surface.kind == "sphere":
            moves = np.eye(3)
            rows = [-normal, -np.ones((len(points), 1))]
        else:
            moves = _across(surface.direction)
            along = (points - surface.point) @ surface.direction
            turn = normal @ moves.T
            rows = [-turn, -np.ones((len(points), 1)), -along[:, None] * turn]
        jacobian = np.concatenate(rows, axis=1)
        weighted = jacobian * weights[:, None]
        normal_matrix = weighted.T @ jacobian
        # a patch of small bend hardly fixes some parameters: a trace of damping keeps the step finite
        normal_matrix += 1e-12 * np.diag(np.maximum(np.diag(normal_matrix), 1e-300))
        step = np.linalg.solve(normal_matrix, -weighted.T @ distance)
        surface = _moved(surface, step, moves, points, weights)
        if not np.isfinite(surface.radius) or np.abs(step).max() < 1e-13 * max(surface.radius, 1e-300):
            break
    return surface


def _moved(surface: Surface, step: np.ndarray, moves: np.ndarray, points: np.ndarray, weights: np.ndarray) -> Surface:
    shift = len(moves)
    point, direction = surface.point + step[:shift] @ moves, surface.direction
    if surface.kind == "cylinder":
        direction = direction + step[shift + 1 :] @ moves
        direction = direction / np.linalg.norm(direction)
        middle = weights @ points / weights.sum()
        point = point + ((middle - point) @ direction) * direction
    return Surface(surface.kind, point, direction, float(abs(surface.radius + step[shift])))


def _across(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2 3"]:
    """Two unit vectors that make a right-angled frame with ``direction``."""
    x, y, z = (float(part) for part in direction)
    least = int(np.argmin(np.abs(direction)))
    a, b, c = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[least]
    length = (a * a + b * b + c * c) ** 0.5
    a, b, c = a / length, b / length, c / length
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])
