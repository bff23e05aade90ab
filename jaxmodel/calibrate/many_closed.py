"""The closed forms over the sums of ``pose_sums.py``: linear in two steps and in one, Tsai and Lenz; batch last."""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.calibrate.linear import SIZED
from jaxmodel.calibrate.pose_sums import Motions, RotationForm, TranslationForm, mean, with_spread
from jaxmodel.calibrate.tsai_lenz import TURN_ABOVE
from jaxmodel.geometry import batch_last as batch


def linear_rotation(form: RotationForm) -> Float[jax.Array, "3 3 b"]:
    """Null vector of eq. 3.13 over all pairs, as a rotation (Proposition 2)."""
    return _rotation(batch.smallest_eigenvector(form.square).reshape(3, 3, -1))


def _rotation(V: Float[jax.Array, "3 3 b"]) -> Float[jax.Array, "3 3 b"]:
    return batch.nearest_rotation(jnp.where(batch.determinant(V) < 0, -V, V))


def linear_translation(form: TranslationForm, R: Float[jax.Array, "3 3 b"]) -> Float[jax.Array, "3 b"]:
    """Least squares for the translation given the rotation (eq. 3.14)."""
    right = batch.apply(batch.transposed(form.across), R.reshape(9, -1)) + form.square[3]
    return -batch.solve_symmetric(form.square[:3, :3], right[:3])


def one_step(rotation: RotationForm, translation: TranslationForm) -> tuple[jax.Array, jax.Array]:
    """Rotation and translation from the 12 unknowns of eq. 3.12 at once.

    Where the translations say nothing of the rotation's size the two steps answer, as in ``linear.py``.
    """
    top = jnp.concatenate([2 * rotation.square + with_spread(translation.spread), translation.across[:, :3]], axis=1)
    bottom = jnp.concatenate([batch.transposed(translation.across[:, :3]), translation.square[:3, :3]], axis=1)
    right = jnp.concatenate([translation.across[:, 3], translation.square[:3, 3]])
    z = -batch.solve_positive(jnp.concatenate([top, bottom]), right)
    V = z[:9].reshape(3, 3, -1)
    sized = batch.determinant(V) > SIZED

    def two_steps() -> tuple[jax.Array, jax.Array]:
        R = linear_rotation(rotation)
        return jnp.where(sized, V, R), jnp.where(sized, z[9:], linear_translation(translation, R))

    V, t = jax.lax.cond(jnp.all(sized), lambda: (V, z[9:]), two_steps)
    return batch.nearest_rotation(V), t


def tsai_lenz_rotation(
    u: Motions, s: Motions, w: Float[jax.Array, "n b"], R_linear: Float[jax.Array, "3 3 b"]
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
    AA, AB, BB = (_axis_products(mean(x[:, None] * y[None], w)) for x, y in ((u.q, u.q), (u.q, p), (p, p)))
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
