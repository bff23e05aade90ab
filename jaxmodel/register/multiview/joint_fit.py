"""All poses at once on all points: every view against every view it shares surface with, both ways.

A chain of pairs adds up their errors, and a graph of pairs only spreads them; here each point may pull on both views it
lies between (Neugebauer 1997; Pulli 1999). Partners are found anew in each round, within a reach that shrinks; within a
round Levenberg-Marquardt moves all poses but the first on the distances to tangent planes. What does not fit is weighed
down (Geman and McClure 1985).
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Bool, Float, Int

from jaxmodel.geometry.elimination import NormalEquations
from jaxmodel.geometry.masked import size_class
from jaxmodel.geometry.se3 import exp
from jaxmodel.register.refine_pair import ALIKE, SOFT, Surface

ROUNDS = 8
FIRST_REACH, LAST_REACH = 0.02, 0.006
"""How far partners may be in the first and in the last round, in the length of the search."""
PARTNERS = 500
"""Of each view within each other view, at most."""
FEWEST = 40
"""Partners of a view within another below which the two say nothing of each other."""
LEAST_SCATTER = 1e-5
MAX_STEPS = 15


class JointFit(NamedTuple):
    """``T_world_view (n, 4, 4)``, the first where it was; ``before`` and ``after``: median distance to tangent planes
    over all partners of the last round's reach, unit of the data; ``deviation_deg (n,)`` and ``deviation (n,)``: the
    largest standard deviation of each view's turn and shift, as the partners' scatter tells; ``improved``: False where
    the poses given were better, which are then returned.
    """

    T_world_view: Float[np.ndarray, "n 4 4"]
    before: float
    after: float
    deviation_deg: Float[np.ndarray, " n"]
    deviation: Float[np.ndarray, " n"]
    improved: bool


class _Partners(NamedTuple):
    """Partners of one round, ``e`` ordered pairs of views with up to ``PARTNERS`` each: a point of ``asked`` lies on
    the tangent plane of a point of ``other``; coordinates in the views' own frames, in the length of the search.
    """

    asked: Int[np.ndarray, " e"]
    other: Int[np.ndarray, " e"]
    point: Float[np.ndarray, "e k 3"]
    partner: Float[np.ndarray, "e k 3"]
    normal: Float[np.ndarray, "e k 3"]
    held: Bool[np.ndarray, "e k"]


class _Problem(eqx.Module):
    poses: Float[jax.Array, "n 4 4"]
    free: Bool[jax.Array, " n"]
    asked: Int[jax.Array, " e"]
    other: Int[jax.Array, " e"]
    point: Float[jax.Array, "e k 3"]
    partner: Float[jax.Array, "e k 3"]
    normal: Float[jax.Array, "e k 3"]
    weight: Float[jax.Array, "e k"]

    def moved(self, tangent: Float[jax.Array, " m"]) -> Float[jax.Array, "n 4 4"]:
        return exp(jnp.where(self.free[:, None], tangent.reshape(-1, 6), 0.0)) @ self.poses

    def distances(self, tangent: Float[jax.Array, " m"]) -> Float[jax.Array, "e k"]:
        T = self.moved(tangent)
        R, t = T[:, :3, :3], T[:, :3, 3]
        there = jnp.einsum("eab,ekb->eka", R[self.asked], self.point) + t[self.asked][:, None]
        here = jnp.einsum("eab,ekb->eka", R[self.other], self.partner) + t[self.other][:, None]
        normal = jnp.einsum("eab,ekb->eka", R[self.other], self.normal)
        return jnp.sum(normal * (there - here), axis=2)

    def residual(self, tangent: Float[jax.Array, " m"]) -> Float[jax.Array, " r"]:
        return (self.distances(tangent) * self.weight).ravel()


def fit_all(surfaces: Sequence[Surface], T_world_view: Float[np.ndarray, "n 4 4"], length: float) -> JointFit:
    """The poses at which all views agree best, from poses near them; ``length``: of the search, unit of the data."""
    start = np.asarray(T_world_view, np.float64)
    middle = np.mean(
        [s.points.mean(axis=0) @ T[:3, :3].T + T[:3, 3] for s, T in zip(surfaces, start, strict=True)], axis=0
    )
    scaled = start.copy()
    scaled[:, :3, 3] = (scaled[:, :3, 3] - middle) / length
    first, information = scaled.copy(), np.zeros((len(start), 6, 6))
    for reach in np.geomspace(FIRST_REACH, LAST_REACH, ROUNDS):
        partners = _partners(surfaces, scaled, float(reach), length)
        if len(partners.asked) == 0:
            break
        scaled, information = _round(partners, scaled)
    before, after = (_disagreement(_partners(surfaces, T, LAST_REACH, length), T) for T in (first, scaled))
    improved = bool(after <= before)
    found = scaled if improved else first
    out = found.copy()
    out[:, :3, 3] = found[:, :3, 3] * length + middle
    turn, shift = _deviations(information)
    return JointFit(out, before * length, (after if improved else before) * length, turn, shift * length, improved)


def disagreement(surfaces: Sequence[Surface], T_world_view: Float[np.ndarray, "n 4 4"], length: float) -> float:
    """Median distance to tangent planes over all views that share surface, unit of the data."""
    scaled = np.asarray(T_world_view, np.float64).copy()
    scaled[:, :3, 3] /= length
    return length * _disagreement(_partners(surfaces, scaled, LAST_REACH, length), scaled)


def _partners(surfaces: Sequence[Surface], T: Float[np.ndarray, "n 4 4"], reach: float, length: float) -> _Partners:
    """Found by trees in the views' own frames; each ordered pair of views that share enough."""
    rows: list[tuple] = []
    boxes = [_box(s, t, length) for s, t in zip(surfaces, T, strict=True)]
    for a, asked in enumerate(surfaces):
        points = asked.points[asked.asked] / length
        world = points @ T[a, :3, :3].T + T[a, :3, 3]
        turned = asked.normals[asked.asked] @ T[a, :3, :3].T
        for b, other in enumerate(surfaces):
            if a == b or (boxes[a][0] > boxes[b][1] + reach).any() or (boxes[b][0] > boxes[a][1] + reach).any():
                continue
            inside = (world - T[b, :3, 3]) @ T[b, :3, :3]
            away, near = other.tree.query(inside * length, distance_upper_bound=reach * length)
            held = np.flatnonzero(np.isfinite(away))
            alike = np.einsum("na,na->n", turned[held] @ T[b, :3, :3], other.normals[near[held]]) > ALIKE
            held = held[alike]
            if len(held) < FEWEST:
                continue
            held = held[np.linspace(0, len(held) - 1, min(PARTNERS, len(held))).astype(int)]
            rows.append((a, b, points[held], other.points[near[held]] / length, other.normals[near[held]]))
    shape = (len(rows), PARTNERS, 3)
    point, partner, normal = (np.zeros(shape) for _ in range(3))
    held = np.zeros(shape[:2], bool)
    for e, (_, _, p, q, n) in enumerate(rows):
        point[e, : len(p)], partner[e, : len(p)], normal[e, : len(p)], held[e, : len(p)] = p, q, n, True
    numbers = np.array([row[:2] for row in rows], np.int64).reshape(-1, 2)
    return _Partners(numbers[:, 0], numbers[:, 1], point, partner, normal, held)


def _round(partners: _Partners, T: Float[np.ndarray, "n 4 4"]) -> tuple[np.ndarray, np.ndarray]:
    """The poses after Levenberg-Marquardt on one round's partners, and the information of each view's own block."""
    distance = _distances(partners, T)
    # each pair of views has a scatter of its own: other noise, other resolution
    scatter = 1.4826 * np.array([np.median(np.abs(d[h])) for d, h in zip(distance, partners.held, strict=True)])
    scatter = np.maximum(scatter, LEAST_SCATTER)[:, None]
    weight = np.where(partners.held, 1 / (1 + (distance / (SOFT * scatter)) ** 2) / scatter, 0.0)
    count = size_class(len(partners.asked), 16)
    pad = count - len(partners.asked)

    def padded(array: np.ndarray) -> np.ndarray:
        return np.concatenate([array, np.zeros((pad, *array.shape[1:]), array.dtype)])

    with jax.enable_x64(True):
        problem = _Problem(
            poses=jnp.asarray(T),
            free=jnp.arange(len(T)) > 0,
            **{
                name: jnp.asarray(padded(getattr(partners, name)))
                for name in ("asked", "other", "point", "partner", "normal")
            },
            weight=jnp.asarray(padded(weight)),
        )
        poses, matrix = _solved(problem)
        blocks = np.asarray(matrix).reshape(len(T), 6, len(T), 6)
        return np.asarray(poses), np.stack([blocks[v, :, v, :] for v in range(len(T))])


@jax.jit
def _solved(problem: _Problem) -> tuple[jax.Array, jax.Array]:
    n = len(problem.poses)
    zero = jnp.zeros(6 * n, problem.poses.dtype)
    solution = optx.least_squares(
        lambda tangent, p: p.residual(tangent),
        optx.LevenbergMarquardt(rtol=1e-8, atol=1e-10, linear_solver=NormalEquations()),
        zero,
        args=problem,
        max_steps=MAX_STEPS,
        throw=False,
    )
    jacobian = jax.jacfwd(problem.residual)(solution.value)
    return problem.moved(solution.value), jacobian.T @ jacobian


def _distances(partners: _Partners, T: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "e k"]:
    R, t = T[:, :3, :3], T[:, :3, 3]
    there = np.einsum("eab,ekb->eka", R[partners.asked], partners.point) + t[partners.asked][:, None]
    here = np.einsum("eab,ekb->eka", R[partners.other], partners.partner) + t[partners.other][:, None]
    normal = np.einsum("eab,ekb->eka", R[partners.other], partners.normal)
    return np.sum(normal * (there - here), axis=2)


def _disagreement(partners: _Partners, T: Float[np.ndarray, "n 4 4"]) -> float:
    if len(partners.asked) == 0:
        return float("inf")
    return float(np.median(np.abs(_distances(partners, T))[partners.held]))


def _deviations(information: Float[np.ndarray, "n 6 6"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Largest standard deviations of turn (degrees) and shift, the other views held; infinite where nothing speaks."""
    turn, shift = np.zeros(len(information)), np.zeros(len(information))
    for v, matrix in enumerate(information):
        if v and np.linalg.eigvalsh(matrix)[0] > 0:
            covariance = np.linalg.inv(matrix)
            turn[v] = np.rad2deg(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1]))
            shift[v] = np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])
        elif v:
            turn[v] = shift[v] = np.inf
    return turn, shift


def _box(surface: Surface, T: Float[np.ndarray, "4 4"], length: float) -> tuple[np.ndarray, np.ndarray]:
    world = surface.points[surface.asked] / length @ T[:3, :3].T + T[:3, 3]
    return world.min(axis=0), world.max(axis=0)
