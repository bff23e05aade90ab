"""Closed forms for very many sets of absolute poses: all pairs of a set at the cost of a sum over its poses.

With ``u_i`` the camera's and ``s_i`` the hand's motion from a reference pose to pose i, the motion between any two is
``A_ij = u_j u_i^-1`` and ``B_ij = s_j s_i^-1``. Every sum over pairs that the linear method and Tsai and Lenz need then
factors into sums over poses. Each pair counts in both directions, so the order of the poses does not matter. There is
no verdict and no residual here: for one set, or to know what its poses determine, use ``calibrate_poses``.
"""

from functools import lru_cache
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Bool, Float

from jaxmodel.calibrate.motions import Setup
from jaxmodel.calibrate.tsai_lenz import TURN_ABOVE
from jaxmodel.errors import InputError
from jaxmodel.geometry import batch_last as batch

Method = Literal["linear", "tsai_lenz"]
BLOCK = 32  # sets worked on together: their sums stay in cache
CHUNK = 128  # blocks of one call


class _Motions(NamedTuple):
    """Motions from the reference pose to each pose: unit quaternion and translation, batch last."""

    q: Float[jax.Array, "4 n b"]
    t: Float[jax.Array, "3 n b"]


def solve_many_poses(
    hand: Float[np.ndarray, "*any"],
    camera: Float[np.ndarray, "*other"],
    mask: Bool[np.ndarray, "*third"] | None = None,
    setup: Setup = Setup.EYE_IN_HAND,
    method: str = "linear",
) -> Float[np.ndarray, "c 4 4"]:
    """The camera's place X (T_hand_camera, or T_base_camera for a fixed camera) of each set, from all its pairs.

    ``hand`` (b, n, 4, 4) is T_base_hand, ``camera`` as ``setup`` says, ``mask`` (b, n) tells which poses are there.
    ``linear`` is the two steps of RR-3507 ch. 3, ``tsai_lenz`` its §2.2.1. A set with fewer than 3 poses, or with a
    pose that is not finite, gives NaN; one whose axes are parallel gives nothing of use.
    """
    hand, camera = np.asarray(hand, np.float64), np.asarray(camera, np.float64)
    if hand.ndim != 4 or hand.shape[2:] != (4, 4) or hand.shape != camera.shape:
        raise InputError(f"hand and camera must both be (batch, n, 4, 4), not {hand.shape} and {camera.shape}.")
    if method not in ("linear", "tsai_lenz"):
        raise InputError(f"method must be linear or tsai_lenz for very many sets, not {method!r}.")
    weight = np.ones(hand.shape[:2]) if mask is None else np.asarray(mask, np.float64)
    if weight.shape != hand.shape[:2]:
        raise InputError(f"mask must be {hand.shape[:2]}, not {weight.shape}.")
    found, devices = np.full((len(hand), 4, 4), np.nan), len(jax.devices())
    # few sets fill few blocks; a power of two of them, so that few shapes are compiled
    blocks = min(CHUNK, 1 << max(0, -(-len(hand) // (BLOCK * devices)) - 1).bit_length())
    size = BLOCK * blocks * devices
    with jax.enable_x64(True):
        solve = _kernel(setup, method, devices)
        for first in range(0, len(hand), size):
            part = [_filled(a[first : first + size], size) for a in (hand, camera, weight)]
            found[first : first + size] = np.asarray(solve(*part))[: len(hand) - first]
    return found


def _filled(array: np.ndarray, size: int) -> np.ndarray:
    return array if len(array) == size else np.concatenate([array, np.repeat(array[:1], size - len(array), axis=0)])


@lru_cache
def _kernel(setup: Setup, method: Method, devices: int) -> Any:
    def one_device(hand: jax.Array, camera: jax.Array, weight: jax.Array) -> jax.Array:
        blocks = [a.reshape(-1, BLOCK, *a.shape[1:]) for a in (hand, camera, weight)]
        found = jax.lax.map(lambda block: _solve_block(block[0], block[1], block[2], setup, method), tuple(blocks))
        return found.reshape(-1, 4, 4)

    split = PartitionSpec("core")
    mesh = Mesh(np.asarray(jax.devices()[:devices]), ("core",))
    return jax.jit(jax.shard_map(one_device, mesh=mesh, in_specs=split, out_specs=split, check_vma=False))


def _solve_block(
    hand: Float[jax.Array, "b n 4 4"],
    camera: Float[jax.Array, "b n 4 4"],
    weight: Float[jax.Array, "b n"],
    setup: Setup,
    method: Method,
) -> Float[jax.Array, "b 4 4"]:
    w = weight.T
    sound = jnp.all(jnp.isfinite(hand) & jnp.isfinite(camera), axis=(2, 3)) | (weight <= 0)
    enough = jnp.all(sound, axis=1) & (jnp.sum(weight > 0, axis=1) >= 3)
    eye = jnp.eye(4, dtype=hand.dtype)[:, :, None, None]
    H, C = (jnp.where(w > 0, jnp.transpose(T, (2, 3, 1, 0)), eye)[:3] for T in (hand, camera))
    # A_ij = C_j C_i^-1 and B_ij = H_j^-1 H_i of the chain H X C = Z (motions.py)
    u = _from_first(_motions(C, setup is Setup.MOVING_FRAMES), w)
    s = _from_first(_motions(H, setup is not Setup.EYE_TO_HAND), w)
    w = w / jnp.sum(w, axis=0)
    R, mean = _linear_rotation(u, s, w)
    if method == "tsai_lenz":
        R = _tsai_lenz_rotation(u, s, w, R)
    t = _translation(u, s, w, R, batch.apply(batch.transposed(mean), R.reshape(9, -1)).reshape(3, 3, -1))
    # X of the set-up is the inverse of the solution of AX = XB
    inverse = batch.transposed(R)
    top = jnp.concatenate([inverse, -batch.apply(inverse, t)[:, None]], axis=1)
    bottom = jnp.broadcast_to(eye[3:, :, :, 0], (1, 4, len(hand)))
    return jnp.where(enough[:, None, None], jnp.transpose(jnp.concatenate([top, bottom]), (2, 0, 1)), jnp.nan)


def _motions(T: Float[jax.Array, "3 4 n b"], inverted: bool) -> _Motions:
    q, t = batch.quaternion(T[:, :3]), T[:, 3]
    if not inverted:
        return _Motions(q, t)
    return _Motions(batch.conjugate(q), -batch.apply(batch.transposed(T[:, :3]), t))


def _from_first(motions: _Motions, w: Float[jax.Array, "n b"]) -> _Motions:
    """``T_i T_r^-1``, r the first pose that is there: small motions keep their digits."""
    place = jnp.arange(len(w))[:, None]
    here = place == jnp.argmax(w > 0, axis=0)
    q_r, t_r = (jnp.sum(jnp.where(here, a, 0.0), axis=1)[:, None] for a in motions)
    q = batch.quaternion_product(motions.q, batch.conjugate(q_r))
    return _Motions(q, motions.t - batch.apply(batch.rotation(q), t_r))


def _mean(values: Float[jax.Array, "... n b"], w: Float[jax.Array, "n b"]) -> Float[jax.Array, "... b"]:
    return jnp.sum(w * values, axis=-2)


def _linear_rotation(u: _Motions, s: _Motions, w: Float[jax.Array, "n b"]) -> tuple[jax.Array, jax.Array]:
    """Null vector of eq. 3.13 over all pairs, as a rotation, and M (9, 9).

    With ``M_i = R_u kron R_s``, ``sum S^T S`` over all pairs is ``I - M M^T``, M the mean of M_i; with ``M = I + E``
    that is ``-(E + E^T) - E E^T``, which loses no digits to the identity.
    """
    a, sym_a = batch.rotation_excess(u.q)
    b, sym_b = batch.rotation_excess(s.q)
    eye = jnp.eye(3, dtype=w.dtype)[:, :, None]
    K = batch.sum_of_krons(w * a, b)
    E = batch.kron(_mean(a, w), eye) + batch.kron(eye, _mean(b, w)) + K
    symmetric = batch.kron(_mean(sym_a, w), eye) + batch.kron(eye, _mean(sym_b, w)) + K + batch.transposed(K)
    V = batch.smallest_eigenvector(-symmetric - batch.matmul(E, batch.transposed(E))).reshape(3, 3, -1)
    return batch.nearest_rotation(jnp.where(batch.determinant(V) < 0, -V, V)), E + jnp.eye(9, dtype=w.dtype)[:, :, None]


def _tsai_lenz_rotation(
    u: _Motions, s: _Motions, w: Float[jax.Array, "n b"], R_linear: Float[jax.Array, "3 3 b"]
) -> Float[jax.Array, "3 3 b"]:
    """``As(n_A + n_B) n = n_B - n_A`` (eq. 2.1, ERRATA) by least squares over all pairs.

    The axes of ``u_j u_i^-1`` are bilinear in the poses' quaternions, so three 4 x 4 means hold all of them. Signs by
    the linear solution; where X turns by nearly pi the hand is first turned by it, as in ``tsai_lenz.py``.
    """
    turned = jnp.trace(R_linear) < 1 + 2 * jnp.cos(TURN_ABOVE)
    first = jnp.where(turned, R_linear, jnp.eye(3, dtype=w.dtype)[:, :, None])
    agreement = u.q[0] * s.q[0] + jnp.sum(u.q[1:] * batch.apply(R_linear[:, :, None], s.q[1:]), axis=0)
    p = jnp.where(agreement < 0, -s.q, s.q)
    p = jnp.concatenate([p[:1], batch.apply(first[:, :, None], p[1:])])
    AA, AB, BB = (_axis_products(_mean(x[:, None] * y[None], w)) for x, y in ((u.q, u.q), (u.q, p), (p, p)))
    scatter = AA + BB + AB + batch.transposed(AB)  # sum (n_A + n_B)(n_A + n_B)^T
    matrix = jnp.trace(scatter) * jnp.eye(3, dtype=w.dtype)[:, :, None] - scatter
    right = -2 * jnp.stack([AB[1, 2] - AB[2, 1], AB[2, 0] - AB[0, 2], AB[0, 1] - AB[1, 0]])
    n = batch.solve_symmetric(matrix, right)
    q = jnp.concatenate([jnp.ones_like(n[:1]), n])  # n = tan(angle / 2) axis, eq. 2.2
    return batch.matmul(batch.rotation(q * jax.lax.rsqrt(jnp.sum(q * q, axis=0))), first)


def _axis_products(P: Float[jax.Array, "4 4 b"]) -> Float[jax.Array, "3 3 b"]:
    """Mean over all pairs of ``vec(x_j x_i*) vec(y_j y_i*)^T`` from ``P``, the mean of ``x_i y_i^T``.

    ``vec(x_j x_i*)_a = x_j^T T_a x_i`` with an antisymmetric T_a, hence ``<T_a, P T_b P^T>``.
    """
    rows = []
    for a in range(3):
        rows.append(jnp.stack([_contract(P, a, b) for b in range(3)]))
    return jnp.stack(rows)


def _contract(P: Float[jax.Array, "4 4 b"], a: int, b: int) -> Float[jax.Array, " b"]:
    terms = [
        sign_a * sign_b * (P[k, m] * P[l, n] - P[l, m] * P[k, n])
        for k, l, sign_a in _AXIS_TERMS[a]
        for m, n, sign_b in _AXIS_TERMS[b]
    ]
    return sum(terms[1:], terms[0])


# vec(x y*)_a = x_a y_0 - x_0 y_a - (x cross y)_a: pairs (k, l) with sign (x_k y_l - x_l y_k)
_AXIS_TERMS = (
    ((1, 0, 1), (2, 3, -1)),
    ((2, 0, 1), (3, 1, -1)),
    ((3, 0, 1), (1, 2, -1)),
)


def _translation(
    u: _Motions,
    s: _Motions,
    w: Float[jax.Array, "n b"],
    R: Float[jax.Array, "3 3 b"],
    mean_W: Float[jax.Array, "3 3 b"],
) -> Float[jax.Array, "3 b"]:
    """Least squares for ``(R_A - I) t + t_A = R t_B`` over all pairs given the rotation (eq. 3.14).

    In the reference pose's axes the residual of a pair is ``(P_i - P_j) t - (x_i - x_j) + W_j (y_i - y_j)`` with
    ``P = R_u^T``, ``x = P t_u``, ``y = R_s^T t_s`` and ``W = P R R_s``, whose mean is ``M^T vec R``.
    """
    a, sym = batch.rotation_excess(u.q)
    mean_a = _mean(a, w)
    matrix = -_mean(sym, w) - batch.matmul(mean_a, batch.transposed(mean_a))  # I minus mean R_u times its transpose
    R_u, R_s, each = batch.rotation(u.q), batch.rotation(s.q), R[:, :, None]
    P, mean_R_u = batch.transposed(R_u), _mean(R_u, w)
    y = batch.apply(batch.transposed(R_s), s.t)
    seen = _mean(u.t, w) - batch.apply(mean_R_u, _mean(batch.apply(P, u.t), w))
    moved = _mean(batch.apply(R_u, batch.apply(mean_W[:, :, None], y)), w)
    moved -= batch.apply(mean_R_u, _mean(batch.apply(P, batch.apply(each, s.t)), w))
    moved += batch.apply(R, _mean(s.t, w) - batch.apply(_mean(R_s, w), _mean(y, w)))
    return batch.solve_symmetric(matrix, seen - 0.5 * moved)
