"""All poses from all pairs: each pair pulls on its two views, and those that do not fit let go.

Levenberg-Marquardt on the motion group (Grisetti et al. 2010), with the residuals of wrong pairs bounded (Geman and
McClure 1985). In float64; pairs are padded, so that sets of similar size share the compiled program.
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
from jaxmodel.geometry.se3 import exp, inverse, log
from jaxmodel.register.multiview.view_graph import Edge

TURN_DEG, SHIFT = 0.5, 0.004
"""Standard deviations of a good pair with half of each view in common: of its turn, and of its shift in the length of
the search."""
SOFT = 4.0
"""Standard deviations at which a pair's pull has fallen to a quarter."""
MAX_STEPS = 200


class GraphFit(NamedTuple):
    """``T_world_view (n, 4, 4)``, the first view where it was; ``residual (e,)`` of each edge in standard deviations;
    ``settled`` whether the steps died down.
    """

    T_world_view: Float[np.ndarray, "n 4 4"]
    residual: Float[np.ndarray, " e"]
    settled: bool


class _Graph(eqx.Module):
    poses: Float[jax.Array, "n 4 4"]
    inverse_motion: Float[jax.Array, "e 4 4"]
    target: Int[jax.Array, " e"]
    source: Int[jax.Array, " e"]
    weight: Float[jax.Array, " e"]
    free: Bool[jax.Array, " n"]

    def moved(self, tangent: Float[jax.Array, " m"]) -> Float[jax.Array, "n 4 4"]:
        return exp(jnp.where(self.free[:, None], tangent.reshape(-1, 6), 0.0)) @ self.poses

    def errors(self, tangent: Float[jax.Array, " m"]) -> Float[jax.Array, "e 6"]:
        """Of each edge: shift and turn in standard deviations, weighed by what it shares."""
        T = self.moved(tangent)
        R, t = T[:, :3, :3], T[:, :3, 3]
        back = jnp.swapaxes(R[self.target], 1, 2)
        between = jnp.zeros((len(self.target), 4, 4), T.dtype).at[:, 3, 3].set(1.0)
        between = between.at[:, :3, :3].set(back @ R[self.source])
        between = between.at[:, :3, 3].set(jnp.einsum("eab,eb->ea", back, t[self.source] - t[self.target]))
        off = log(self.inverse_motion @ between)
        unit = jnp.concatenate([jnp.full(3, SHIFT), jnp.full(3, np.deg2rad(TURN_DEG))])
        return off / unit * self.weight[:, None]

    def residual(self, tangent: Float[jax.Array, " m"]) -> Float[jax.Array, " k"]:
        errors = self.errors(tangent)
        squared = jnp.sum(errors**2, axis=1, keepdims=True)
        return (errors / jnp.sqrt(1.0 + squared / SOFT**2)).ravel()


def fit_graph(
    edges: Sequence[Edge], T_world_view: Float[np.ndarray, "n 4 4"], centres: Float[np.ndarray, "n 3"], length: float
) -> GraphFit:
    """The poses that agree best with all pairs, from poses near them.

    ``centres (n, 3)`` of the views, own frames; ``length`` of the search, unit of the data. Both make errors about the
    objects' own place, whatever the frames' origins.
    """
    n, count = len(T_world_view), size_class(len(edges), 16)
    pad = count - len(edges)
    with jax.enable_x64(True):
        # frames about each view's centre, lengths in that of the search
        about = np.tile(np.eye(4), (n, 1, 1))
        about[:, :3, 3] = centres
        middle = np.einsum("nab,nb->na", T_world_view[:, :3, :3], centres) + T_world_view[:, :3, 3]
        world = np.eye(4)
        world[:3, 3] = middle.mean(axis=0)
        scaled = _scaled(inverse(world) @ T_world_view @ about, length)
        motions = np.stack(
            [_scaled(inverse(about[e.target]) @ e.T_target_source @ about[e.source], length) for e in edges]
            + [np.eye(4)] * pad
        )
        weight = [np.sqrt(2 * max(e.common, 0.02)) for e in edges] + [0.0] * pad
        graph = _Graph(
            poses=jnp.asarray(scaled),
            inverse_motion=jnp.asarray(inverse(motions)),
            target=jnp.asarray([e.target for e in edges] + [0] * pad),
            source=jnp.asarray([e.source for e in edges] + [0] * pad),
            weight=jnp.asarray(weight),
            free=jnp.arange(n) > 0,
        )
        poses, errors, settled = _solved(graph)
        found = world @ _scaled(np.asarray(poses), 1 / length) @ inverse(about)
        residual = np.linalg.norm(np.asarray(errors), axis=1)[: len(edges)]
        return GraphFit(found, residual / np.asarray(weight[: len(edges)]), bool(settled))


def _scaled(T: Float[np.ndarray, "*n 4 4"], length: float) -> Float[np.ndarray, "*n 4 4"]:
    out = np.array(T)
    out[..., :3, 3] /= length
    return out


@jax.jit
def _solved(graph: _Graph) -> tuple[jax.Array, jax.Array, jax.Array]:
    solution = optx.least_squares(
        lambda tangent, g: g.residual(tangent),
        optx.LevenbergMarquardt(rtol=1e-7, atol=1e-7, linear_solver=NormalEquations()),
        jnp.zeros(6 * len(graph.poses), graph.poses.dtype),
        args=graph,
        max_steps=MAX_STEPS,
        throw=False,
    )
    return graph.moved(solution.value), graph.errors(solution.value), solution.result == optx.RESULTS.successful
