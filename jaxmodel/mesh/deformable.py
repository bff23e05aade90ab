"""A closed surface drawn onto a cloud: a mass-spring sphere under internal and external forces (thesis §3.2.3).

Every vertex of an icosphere is a unit mass with viscous damping. Springs draw it to the mean of its neighbours, along
the surface (even spacing) and across it (smoothness); a measured point within reach attracts it; where none is, a
pressure moves it along its normal, inwards from outside the cloud or outwards from inside. The mesh stays closed, and
deep concavities stay covered: prefer ball pivoting for open scenes and holes (thesis Table 3.1).
"""

from enum import IntEnum
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt

from jaxmodel.errors import InputError
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.nearest import VoxelTable, build_table, gather, nearest_table
from jaxmodel.geometry.voxel_grid import cube_around
from jaxmodel.scan.triangle_mesh import ObjectMesh, icosphere

CELLS = 64
CANDIDATES = 8
_ROOM_CELLS = 32
FEWEST_POINTS = 4


class DeformableOutcome(IntEnum):
    """How the surface came to rest."""

    CONVERGED = 0
    MAX_STEPS = 1

    @property
    def sentence(self) -> str:
        return {
            DeformableOutcome.CONVERGED: "the surface came to rest",
            DeformableOutcome.MAX_STEPS: "the surface still moved when the number of steps was reached",
        }[self]


class DeformableOptions(eqx.Module):
    """Forces are accelerations a step, in lengths of the sphere's mean edge where they do not scale with a distance.

    ``attraction`` and ``reach`` (in mean edges) belong to measured points, ``pressure`` to vertices out of reach;
    ``spacing`` and ``smoothing`` are the springs along and across the surface; ``damping`` is the share of its speed
    that a vertex loses in a step. It rests when the vertices' motion in a step (root of the mean square) is at most
    ``tolerance`` mean edges. Each order halves the edges, and so doubles the steps of the way to the cloud.
    """

    attraction: float = 0.15
    reach: float = 3.0
    pressure: float = 0.04
    spacing: float = 0.3
    smoothing: float = 0.03
    damping: float = 0.5
    tolerance: float = 0.002
    max_steps: int = 1500


class DeformedSurface(NamedTuple):
    """``mesh`` in the cloud's frame and unit; ``distance`` from each vertex to its closest point."""

    mesh: ObjectMesh
    distance: Float[np.ndarray, " v"]
    outcome: DeformableOutcome
    steps: int

    @property
    def error(self) -> float:
        """Mean distance of the vertices from their closest points."""
        return float(self.distance.mean())


class _Sphere(eqx.Module):
    """``ring`` are each vertex's neighbours in order around it; with five the first comes twice."""

    ring: Int[AnyArray, "6 v"]
    five: Float[AnyArray, " v"]  # 1 where a vertex has five neighbours


class _State(eqx.Module):
    place: Float[jax.Array, "3 v"]
    speed: Float[jax.Array, "3 v"]
    step: Int[jax.Array, ""]
    motion: Float[jax.Array, ""]


def deform(
    points: Float[np.ndarray, "n 3"],
    order: int = 5,
    start: Literal["outside", "inside"] = "outside",
    options: DeformableOptions | None = None,
) -> DeformedSurface:
    """The icosphere of an order, drawn onto a cloud.

    Args:
        points: the cloud, any unit.
        order: as the thesis counts: 5 has 5120 triangles, 6 has 20 480 (one subdivision less than the order).
        start: a sphere around the cloud that shrinks, or a small one at its centroid that grows.
        options: the forces and when to stop.

    Raises:
        InputError: fewer than four points, a point that is not finite, all points on one spot, or an order below 1.
    """
    points = np.asarray(points, np.float64)
    if order < 1:
        raise InputError(f"order is {order}, expected 1 or more (5: 5120 triangles, 6: 20 480).")
    if len(points) < FEWEST_POINTS:
        raise InputError(f"The cloud has {len(points)} points, expected at least {FEWEST_POINTS}.")
    if not np.isfinite(points).all():
        row = int(np.argmax(~np.isfinite(points).all(axis=1)))
        raise InputError(f"Point {row} (counted from 0) of the cloud is not finite.")
    low, high = points.min(axis=0), points.max(axis=0)
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    if size <= np.abs(points).max() * 1e-12:
        raise InputError("All points of the cloud lie on one spot: there is no surface to find.")
    cloud = (points - centre) / size  # within the unit sphere
    ball = icosphere(order - 1)
    sphere = _sphere(ball)
    inside = start == "inside"
    middle, radius = _roomiest_place(cloud) if inside else (np.zeros(3), 1.05)
    first = radius * ball.vertices + middle
    edge = float(np.sqrt(4 * np.pi * 0.25 / (len(ball.faces) * np.sqrt(3) / 4)))  # at half the cloud's radius
    table = build_table(cloud, CELLS, CANDIDATES, margin=0.3)
    place, steps, moving = _run(
        sphere,
        table,
        jnp.asarray(cloud.T, jnp.float32),
        jnp.asarray(first.T, jnp.float32),
        DeformableOptions() if options is None else options,
        jnp.float32(edge),
        jnp.float32(1.0 if inside else -1.0),
    )
    vertices = np.asarray(place, np.float64).T
    closest = _closest(table, jnp.asarray(cloud.T, jnp.float32), jnp.asarray(place))
    distance = np.linalg.norm(np.asarray(closest, np.float64).T - vertices, axis=1) * size
    outcome = DeformableOutcome.MAX_STEPS if bool(moving) else DeformableOutcome.CONVERGED
    return DeformedSurface(ObjectMesh(vertices * size + centre, ball.faces), distance, outcome, int(steps))


def _roomiest_place(cloud: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "3"], float]:
    """A ball that the cloud surrounds, half the size of the largest: seen from its centre, points lie along at least
    five of the six ways of the axes (a standing object was not scanned from below). Without such a place, a small ball
    at the centroid."""
    grid = cube_around(cloud, _ROOM_CELLS, 0.0)
    occupied = np.zeros(_ROOM_CELLS**3, bool)
    occupied[grid.keys(np.clip(grid.indices(cloud), 0, _ROOM_CELLS - 1))] = True
    occupied = occupied.reshape(grid.shape)
    ways = np.zeros(grid.shape, np.int64)
    for axis in range(3):
        for way in (slice(None), slice(None, None, -1)):
            along = np.moveaxis(occupied, axis, 0)[way]
            ways += np.moveaxis(np.logical_or.accumulate(along, axis=0)[way], 0, axis)
    surrounded = ~occupied & (ways >= 5)
    if not surrounded.any():
        return cloud.mean(axis=0), 0.1
    room = np.where(surrounded, np.asarray(distance_transform_edt(~occupied)), 0.0)
    best = int(np.argmax(room))
    return grid.centres(np.array([best]))[0], 0.5 * float(room.flat[best]) * float(grid.cell)


def _sphere(ball: ObjectMesh) -> _Sphere:
    """The neighbours of every vertex in order, from the triangles around it."""
    count = len(ball.vertices)
    at = ball.faces.reshape(-1)
    following, last = ball.faces[:, [1, 2, 0]].reshape(-1), ball.faces[:, [2, 0, 1]].reshape(-1)
    # around vertex a, the triangle (a, b, c) leads from b to c
    successor = dict(zip(zip(at.tolist(), following.tolist(), strict=True), last.tolist(), strict=True))
    first = np.zeros(count, np.int64)
    first[at] = following
    ring = [first]
    for _ in range(5):
        ring.append(np.array([successor[pair] for pair in zip(range(count), ring[-1].tolist(), strict=True)]))
    five = ring[5] == ring[0]
    return _Sphere(np.stack(ring).astype(np.int32), five.astype(np.float32))


def _closest(table: VoxelTable, cloud: Float[jax.Array, "3 n"], place: Float[jax.Array, "3 v"]) -> jax.Array:
    index = nearest_table(table, cloud, place, 1).index[0]
    return jnp.stack([gather(axis, index) for axis in cloud])


@jax.jit
def _run(
    sphere: _Sphere,
    table: VoxelTable,
    cloud: Float[jax.Array, "3 n"],
    first: Float[jax.Array, "3 v"],
    options: DeformableOptions,
    edge: Float[jax.Array, ""],
    outwards: Float[jax.Array, ""],
) -> tuple[Float[jax.Array, "3 v"], Int[jax.Array, ""], jax.Array]:
    neighbours = 6.0 - sphere.five

    def forces(place: Float[jax.Array, "3 v"]) -> Float[jax.Array, "3 v"]:
        around = [jnp.stack([gather(axis, index) for axis in place]) for index in sphere.ring]
        spokes = [other - place for other in around]
        normal = sum(jnp.cross(a, b, axis=0) for a, b in zip(spokes, [*spokes[1:], spokes[0]], strict=True))
        normal = normal / jnp.maximum(jnp.sqrt(jnp.sum(normal**2, axis=0)), 1e-12)
        towards_mean = (sum(spokes) - sphere.five * spokes[5]) / neighbours
        across = jnp.sum(towards_mean * normal, axis=0) * normal
        springs = options.spacing * (towards_mean - across) + options.smoothing * across
        pull = _closest(table, cloud, place) - place
        within = jnp.sqrt(jnp.sum(pull**2, axis=0)) < options.reach * edge
        length = sum(jnp.sqrt(jnp.sum(spoke**2, axis=0)) for spoke in spokes) / 6.0
        return springs + jnp.where(
            within, options.attraction * pull, options.pressure * outwards * jnp.minimum(length, edge) * normal
        )

    def step(state: _State) -> _State:
        speed = (1.0 - options.damping) * state.speed + forces(state.place)
        motion = jnp.sqrt(jnp.mean(jnp.sum(speed**2, axis=0)))
        return _State(state.place + speed, speed, state.step + 1, motion)

    def moving(state: _State) -> jax.Array:
        return (state.step < options.max_steps) & (state.motion > options.tolerance * edge)

    begin = _State(first, jnp.zeros_like(first), jnp.zeros((), jnp.int32), jnp.asarray(jnp.inf, first.dtype))
    end = jax.lax.while_loop(moving, step, begin)
    return end.place, end.step, end.motion > options.tolerance * edge
