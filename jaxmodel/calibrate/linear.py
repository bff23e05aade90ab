"""The linear solver by Kronecker products (RR-3507 ch. 3): in two steps, or in one.

Prefer it for small motions and as the start of everything else: it needs no axes, no angles and no start itself. Two
steps do not depend on the unit of length. One step (eq. 3.12, 12 unknowns) is better for very small noisy motions, and
depends on the unit of length; it still answers in some sets that leave the rotation block alone deficient.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.pairs import NO_ROTATION, Pairs, PairSums, exchanged, motion_excess, pair_sums
from jaxmodel.geometry.eigen import smallest_eigenvector
from jaxmodel.geometry.elimination import solve_semidefinite
from jaxmodel.geometry.polar import nearest_rotation

SIZED = 1 / 8  # least determinant of a one-step solution: half a rotation's size, as much noise as measurement
SHARED = 1e-2  # least share of vec R_X in the null vector of eq. 4.2, its columns brought to one size


def solve_linear(pairs: Pairs, unknown_scale: bool = False) -> Estimate:
    """Rotation from eq. 3.13, then translation from eq. 3.14 (with the scale: eq. 4.3)."""
    sums = pair_sums(pairs)
    R = linear_rotation(sums)
    return linear_translation(sums, R, unknown_scale)


def linear_rotation(sums: PairSums) -> Float[jax.Array, "3 3"]:
    """Proposition 2: the null vector of eq. 3.13 scaled to a positive determinant, then the nearest rotation."""
    V = smallest_eigenvector(sums.rotation).reshape(3, 3)
    determinant = jnp.dot(V[0], jnp.cross(V[1], V[2]))
    return nearest_rotation(jnp.where(determinant < 0, -V, V))


def linear_translation(sums: PairSums, R: Float[jax.Array, "3 3"], unknown_scale: bool) -> Estimate:
    """Least squares for the translation, and the scale if unknown, given the rotation (eqs 3.14, 4.3)."""
    Q, r = sums.translation, R.reshape(9)
    least = NO_ROTATION * sums.weight
    if unknown_scale:
        lengths = jnp.stack([least, least, least, jnp.zeros_like(least)])
        solution = solve_semidefinite(Q[9:, 9:], -(Q[9:, :9] @ r), least=lengths)
        return Estimate(R, solution[:3], solution[3])
    t = solve_semidefinite(Q[9:12, 9:12], -(Q[9:12, :9] @ r + Q[9:12, 12]), least=least)
    return Estimate(R, t, jnp.ones((), t.dtype))


def solve_one_step(pairs: Pairs, unknown_scale: bool = False) -> Estimate:
    """Least squares for the 12 unknowns of eq. 3.12 at once, the rotation part then made a rotation.

    With an unknown scale the 13 unknowns of eq. 4.2 are homogeneous: their null vector, scaled by its determinant.
    Only B's translations say how long vec R_X is: in pure rotations of B (Propositions 1 and 2) least squares make it
    zero in eq. 3.12, and eq. 4.2 leaves it open. Where they say less of it than the noise, the two steps answer.
    """
    sums = pair_sums(pairs)
    Q = sums.translation.at[:9, :9].add(sums.rotation)
    if unknown_scale:
        spread = jnp.sqrt(jnp.maximum(jnp.diagonal(Q), jnp.finfo(Q.dtype).tiny))
        unit = smallest_eigenvector(Q / spread[:, None] / spread[None, :])
        z, sized = unit / spread, jnp.sum(unit[:9] ** 2) > SHARED
    else:
        z = jnp.append(solve_semidefinite(Q[:12, :12], -Q[:12, 12]), 1.0)
        for _ in range(2):  # the normal matrix squares the condition; residuals taken row by row win it back
            z = z.at[:12].add(solve_semidefinite(Q[:12, :12], -_gradient(pairs, z)[:12]))
        sized = _determinant(z) > SIZED
    if unknown_scale:
        determinant = _determinant(z)
        z = z / jnp.where(determinant == 0, 1.0, jnp.cbrt(determinant))
    whole = Estimate(nearest_rotation(z[:9].reshape(3, 3)), z[9:12], z[12])
    steps = linear_translation(sums, linear_rotation(sums), unknown_scale)
    return jax.tree.map(lambda one, two: jnp.where(sized, one, two), whole, steps)


def _determinant(z: Float[jax.Array, "13"]) -> Float[jax.Array, ""]:
    V = z[:9].reshape(3, 3)
    return jnp.dot(V[0], jnp.cross(V[1], V[2]))


def _gradient(pairs: Pairs, z: Float[jax.Array, "13"]) -> Float[jax.Array, "13"]:
    """``sum w J^T (J z)`` of eq. 3.12, from the residual of each row."""
    V, t, w = z[:9].reshape(3, 3), z[9:12], pairs.weight
    a, b = motion_excess(pairs), motion_excess(exchanged(pairs))
    aV, Vb = a @ V, jnp.einsum("ij,nkj->nik", V, b)
    turned = -(aV + Vb + jnp.einsum("nij,njk->nik", a, Vb))  # V - R_A V R_B^T
    back = jnp.einsum("nji,njk->nik", a, turned)
    # S^T applied to a residual E is E - R_A^T E R_B
    adjoint = -(back + turned @ b + jnp.einsum("nij,njk->nik", back, b))
    shifted = a @ t + z[12] * pairs.t_A - pairs.t_B @ V.T
    for_V = jnp.tensordot(w, adjoint, 1) - jnp.einsum("n,ni,nj->ij", w, shifted, pairs.t_B)
    for_t = jnp.einsum("n,nji,nj->i", w, a, shifted)
    return jnp.concatenate([for_V.reshape(9), for_t, jnp.einsum("n,ni,ni->", w, pairs.t_A, shifted)[None]])
