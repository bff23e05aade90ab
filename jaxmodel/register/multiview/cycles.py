"""Three views around a cycle, their motions corrected by each other (thesis §2.8).

Each motion should be what the two others make of it: ``T_AB = (T_BC T_CA)^-1``. Replacing it outright would trade one
error for two; here each is moved a third of the way, on the motion group, which closes the cycle at once to first
order and shares its error out evenly. A few steps of registration follow, and so on until the cycle is closed.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.se3 import inverse, rotation_angle_deg
from jaxmodel.register.multiview.fusion import Fused, first_guess, fuse
from jaxmodel.register.multiview.view_graph import Edge
from jaxmodel.register.refine_pair import refine

ROUNDS = 4
"""Of correction and registration."""


class Cycle(NamedTuple):
    """Three fused parts a, b, c with the motions between them, and how far they are from closing.

    ``opening_deg`` and ``opening`` (unit of the data, at a's middle) before and after the correction.
    """

    T_ab: Float[np.ndarray, "4 4"]
    T_bc: Float[np.ndarray, "4 4"]
    T_ca: Float[np.ndarray, "4 4"]
    opening_deg: tuple[float, float]
    opening: tuple[float, float]


def close_cycle(a: Fused, b: Fused, c: Fused, edges: Sequence[Edge], length: float) -> Cycle | None:
    """Register around three parts and correct each motion by the two others; None where a pair is not joined."""
    pairs = (a, b), (b, c), (c, a)
    guesses = [guess for pair in pairs if (guess := first_guess(*pair, edges)) is not None]
    if len(guesses) < len(pairs):
        return None
    motions = [
        refine(x.surface, y.surface, T, length).T_target_source for (x, y), T in zip(pairs, guesses, strict=True)
    ]
    centre = a.surface.points.mean(axis=0)
    first = _opening(motions, centre)
    for round_ in range(ROUNDS):
        motions = shared_out(motions, [p[0].surface.points.mean(axis=0) for p in pairs])
        if round_ < ROUNDS - 1:
            motions = [
                refine(x.surface, y.surface, T, length).T_target_source
                for (x, y), T in zip(pairs, motions, strict=True)
            ]
    last = _opening(motions, centre)
    return Cycle(*motions, opening_deg=(first[0], last[0]), opening=(first[1], last[1]))


def shared_out(motions: Sequence[np.ndarray], centres: Sequence[np.ndarray]) -> list[Float[np.ndarray, "4 4"]]:
    """The three motions, each a third of the way to the inverse of the two others one after the other."""
    out = []
    for k, T in enumerate(motions):
        other = inverse(motions[(k + 1) % 3] @ motions[(k + 2) % 3])
        out.append(between(T, other, 1 / 3, centres[k]))
    return out


def between(T: np.ndarray, other: np.ndarray, share: float, centre: Float[np.ndarray, "3"]) -> np.ndarray:
    """A motion on the way from one to another: turned by a share of the turn, what maps to ``centre`` moved by it."""
    turn = Rotation.from_matrix(other[:3, :3] @ T[:3, :3].T)
    inner = T[:3, :3].T @ (centre - T[:3, 3])
    moved = other[:3, :3] @ inner + other[:3, 3] - centre
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(share * turn.as_rotvec()).as_matrix() @ T[:3, :3]
    out[:3, 3] = centre + share * moved - out[:3, :3] @ inner
    return out


def fuse_cycle(a: Fused, b: Fused, c: Fused, edges: Sequence[Edge], length: float) -> tuple[Fused, Cycle] | None:
    """The three as one, in a's frame, after the cycle is closed."""
    cycle = close_cycle(a, b, c, edges, length)
    if cycle is None:
        return None
    ab = fuse(a, b, cycle.T_ab, length, fit=False)
    return fuse(ab, c, inverse(cycle.T_ca), length, fit=False), cycle


def best_cycle(parts: Sequence[Fused], edges: Sequence[Edge]) -> tuple[int, int, int] | None:
    """The three parts all joined with each other whose weakest pair shares most."""
    from jaxmodel.register.multiview.fusion import likeness

    best, found = 0.0, None
    for three in combinations(range(len(parts)), 3):
        weakest = min(likeness(parts[i], parts[j], edges) for i, j in combinations(three, 2))
        if weakest > best:
            best, found = weakest, three
    return found


def _opening(motions: Sequence[np.ndarray], centre: Float[np.ndarray, "3"]) -> tuple[float, float]:
    around = motions[0] @ motions[1] @ motions[2]
    moved = around[:3, :3] @ centre + around[:3, 3] - centre
    return float(rotation_angle_deg(around[:3, :3])), float(np.linalg.norm(moved))
