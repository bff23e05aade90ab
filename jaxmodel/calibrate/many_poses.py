"""Very many sets of absolute poses: all pairs of a set at the cost of a sum over its poses.

With ``u_i`` the camera's and ``s_i`` the hand's motion from a reference pose to pose i, the motion between any two is
``A_ij = u_j u_i^-1`` and ``B_ij = s_j s_i^-1``. Every sum over pairs that the methods need then factors into sums over
poses (``pose_sums.py``). Each pair counts in both directions, so the order of the poses does not matter. There is no
verdict and no residual here: for one set, or to know what its poses determine, use ``calibrate_poses``.
"""

from functools import lru_cache
from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Bool, Float

from jaxmodel.calibrate.many_closed import linear_rotation, linear_translation, one_step, tsai_lenz_rotation
from jaxmodel.calibrate.many_nonlinear import nonlinear
from jaxmodel.calibrate.motions import Setup
from jaxmodel.calibrate.pose_sums import Motions, from_first, motions, rotation_form, translation_form
from jaxmodel.errors import InputError
from jaxmodel.geometry import batch_last as batch

Method = Literal["linear", "linear_one_step", "tsai_lenz", "nonlinear"]
METHODS: tuple[Method, ...] = get_args(Method)
BLOCK = 32  # sets worked on together: their sums stay in cache
CHUNK = 128  # blocks of one call


def solve_many_poses(
    hand: Float[np.ndarray, "*any"],
    camera: Float[np.ndarray, "*other"],
    mask: Bool[np.ndarray, "*third"] | None = None,
    setup: Setup = Setup.EYE_IN_HAND,
    method: str = "linear",
) -> Float[np.ndarray, "c 4 4"]:
    """The camera's place X (T_hand_camera, or T_base_camera for a fixed camera) of each set, from all its pairs.

    ``hand`` (b, n, 4, 4) is T_base_hand, ``camera`` as ``setup`` says, ``mask`` (b, n) tells which poses are there.
    ``linear`` is the two steps of RR-3507 ch. 3, ``linear_one_step`` its eq. 3.12 with the hand's motions for A, which
    is OpenCV's ANDREFF and depends on the unit of length, ``tsai_lenz`` its §2.2.1, ``nonlinear`` the answer of
    ``solve_nonlinear`` with the noise in the camera. A set with fewer than 3 poses, or with a pose that is not finite,
    gives NaN; one whose axes are parallel gives nothing of use.
    """
    hand, camera = np.asarray(hand, np.float64), np.asarray(camera, np.float64)
    if hand.ndim != 4 or hand.shape[2:] != (4, 4) or hand.shape != camera.shape:
        raise InputError(f"hand and camera must both be (batch, n, 4, 4), not {hand.shape} and {camera.shape}.")
    if method not in METHODS:
        raise InputError(f"method must be one of {', '.join(METHODS)} for very many sets, not {method!r}.")
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
    u = from_first(motions(C, setup is Setup.MOVING_FRAMES), w)
    s = from_first(motions(H, setup is not Setup.EYE_TO_HAND), w)
    w = w / jnp.sum(w, axis=0)
    R, t = _solved(u, s, w, jnp.sum(weight > 0, axis=1, dtype=w.dtype), method)
    top = jnp.concatenate([R, t[:, None]], axis=1)
    bottom = jnp.broadcast_to(eye[3:, :, :, 0], (1, 4, len(hand)))
    return jnp.where(enough[:, None, None], jnp.transpose(jnp.concatenate([top, bottom]), (2, 0, 1)), jnp.nan)


def _solved(
    u: Motions, s: Motions, w: Float[jax.Array, "n b"], poses: Float[jax.Array, " b"], method: Method
) -> tuple[Float[jax.Array, "3 3 b"], Float[jax.Array, "3 b"]]:
    """X of the set-up from the motions of the camera (u) and of the hand (s)."""
    turns = rotation_form(u, s, w)
    if method == "linear_one_step":
        return one_step(turns.exchanged(), translation_form(s, u, w, turns.exchanged().mean))
    # A is the camera's motion, as in RR-3507: X is the inverse of the solution
    R = linear_rotation(turns)
    if method == "tsai_lenz":
        R = tsai_lenz_rotation(u, s, w, R)
    t = linear_translation(translation_form(u, s, w, turns.mean), R)
    R, t = batch.transposed(R), -batch.apply(batch.transposed(R), t)
    if method != "nonlinear":
        return R, t
    # the camera carries the noise: what multiplies the unknowns is the hand's
    return nonlinear(turns.exchanged(), translation_form(s, u, w, turns.exchanged().mean), R, t, poses)
