"""Views of one object in one frame: every order of fusion arrives, cycles close, all points at once are never worse."""

from itertools import combinations
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.se3 import inverse, rotation_angle_deg
from jaxmodel.io.datasets import MeshViews
from jaxmodel.register.multiview.cycles import between, close_cycle, shared_out
from jaxmodel.register.multiview.fusion import first_guess, fuse, likeness, single
from jaxmodel.register.multiview.joint_fit import disagreement, fit_all
from jaxmodel.register.multiview.variants import VARIANTS, fuse_views
from jaxmodel.register.multiview.view_graph import Edge
from jaxmodel.register.refine_pair import Surface, surface_of
from jaxmodel.scan.cloud import as_cloud
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.sensor import Sensor

COUNT = 6


class Ring(NamedTuple):
    """Views around an object, their poses, the pairs of neighbours, and pairs that are a little off."""

    surfaces: list[Surface]
    centres: np.ndarray
    T: np.ndarray
    edges: list[Edge]


@pytest.fixture(scope="module")
def ring() -> Ring:
    angles = [60.0 * k for k in range(COUNT)]
    views = MeshViews("gourd", object_mesh("gourd"), angles, Sensor(width=120, height=120), Laser(sigma=0.0005), seed=2)
    clouds = [as_cloud(views.scan(name)) for name in views.names]
    clouds = [cloud.take(~cloud.border) for cloud in clouds if cloud.border is not None]
    T = np.stack([views.T_world_scan(name) for name in views.names])
    T = inverse(T[0]) @ T
    centres = np.stack([cloud.points.mean(axis=0) for cloud in clouds])
    draw = np.random.default_rng(0)
    edges = []
    for a, b in combinations(range(COUNT), 2):
        apart = min(b - a, COUNT - (b - a))
        if apart <= 2:
            edges.append(
                Edge(a, b, _off(inverse(T[a]) @ T[b], centres[b], draw), 0.95, (0.5 / apart, 0.5 / apart), 1e-3)
            )
    return Ring([surface_of(cloud) for cloud in clouds], centres, T, edges)


def _off(T: np.ndarray, centre: np.ndarray, draw: np.random.Generator, turn: float = 0.03, shift: float = 0.01):
    out = T.copy()
    out[:3, :3] = Rotation.from_rotvec(turn * draw.normal(size=3) / 1.7).as_matrix() @ T[:3, :3]
    out[:3, 3] = T[:3, :3] @ centre + T[:3, 3] + shift * draw.normal(size=3) / 1.7 - out[:3, :3] @ centre
    return out


def _errors(ring: Ring, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turn = rotation_angle_deg(np.swapaxes(T[:, :3, :3], 1, 2) @ ring.T[:, :3, :3])
    off = np.einsum("nab,nb->na", (T - ring.T)[:, :3, :3], ring.centres) + (T - ring.T)[:, :3, 3]
    return np.asarray(turn), np.linalg.norm(off, axis=1)


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_order_arrives(ring, variant):
    order = fuse_views(ring.surfaces, ring.edges, variant, 1.0)
    turn, shift = _errors(ring, order.T_world_view)
    assert turn.max() < 1.0 and shift.max() < 0.01
    assert {view for step in order.steps for part in step for view in part} >= set(range(1, COUNT)) - {0}
    if variant in ("cycle_views", "cycle_of_cycles"):
        assert order.cycles and all(cycle.opening_deg[1] < 1e-3 for _, cycle in order.cycles)


def test_all_points_at_once_make_a_chain_better(ring):
    """A chain around the object leaves its errors to the last view; all at once they are a third and less."""
    draw = np.random.default_rng(5)
    chain = [np.eye(4)]
    for k in range(COUNT - 1):
        chain.append(chain[-1] @ _off(inverse(ring.T[k]) @ ring.T[k + 1], ring.centres[k + 1], draw, 0.015, 0.005))
    before, fit = _errors(ring, np.stack(chain)), fit_all(ring.surfaces, np.stack(chain), 1.0)
    after = _errors(ring, fit.T_world_view)
    assert fit.improved and fit.after < 0.5 * fit.before
    assert after[0].max() < 0.35 * before[0].max() and after[1].max() < 0.35 * before[1].max()
    assert np.array_equal(fit.T_world_view[0], np.eye(4)) or np.allclose(fit.T_world_view[0], np.eye(4), atol=1e-12)
    assert (fit.deviation_deg[1:] > 0).all() and np.isfinite(fit.deviation).all()


def test_all_points_at_once_are_never_worse(ring):
    for T in (ring.T, fit_all(ring.surfaces, ring.T, 1.0).T_world_view):
        fit = fit_all(ring.surfaces, T, 1.0)
        assert fit.after <= fit.before
        assert disagreement(ring.surfaces, fit.T_world_view, 1.0) <= disagreement(ring.surfaces, T, 1.0) * (1 + 1e-6)


def test_the_world_frame_of_the_fit_does_not_matter(ring):
    A = np.eye(4)
    A[:3, :3], A[:3, 3] = Rotation.from_euler("xyz", [10, 80, -30], degrees=True).as_matrix(), [4.0, 1.0, -7.0]
    plain, moved = (fit_all(ring.surfaces, start, 1.0).T_world_view for start in (ring.T, A @ ring.T))
    assert np.allclose(inverse(A) @ moved, plain, atol=1e-5)


def test_a_corrected_cycle_is_closed_and_nearer_the_truth(ring):
    draw = np.random.default_rng(9)
    pairs = ((0, 1), (1, 2), (2, 0))
    exact = [inverse(ring.T[a]) @ ring.T[b] for a, b in pairs]
    centres = [ring.surfaces[a].points.mean(axis=0) for a, _ in pairs]
    shared = shared_out(exact, centres)
    assert all(np.allclose(a, b, atol=1e-9) for a, b in zip(shared, exact, strict=True))
    off = [_off(T, ring.centres[b], draw) for T, (_, b) in zip(exact, pairs, strict=True)]
    once = shared_out(off, centres)

    def opening(motions) -> float:
        return float(rotation_angle_deg((motions[0] @ motions[1] @ motions[2])[:3, :3]))

    assert opening(once) < 0.1 * opening(off)
    parts = [single(k, ring.surfaces[k]) for k in range(3)]
    cycle = close_cycle(parts[0], parts[1], parts[2], ring.edges, 1.0)
    assert cycle is not None and cycle.opening_deg[1] < 1e-3 * max(cycle.opening_deg[0], 1.0)
    assert rotation_angle_deg(cycle.T_ab[:3, :3].T @ exact[0][:3, :3]) < 0.5
    assert close_cycle(parts[0], parts[1], single(3, ring.surfaces[3]), ring.edges[:1], 1.0) is None


def test_between_two_motions_lies_half_of_the_way():
    draw = np.random.default_rng(1)
    a, centre = np.eye(4), np.array([0.2, 0.1, 2.0])
    b = _off(a, centre, draw, 0.4, 0.2)
    middle = between(a, b, 0.5, centre)
    assert np.allclose(between(a, b, 0.0, centre), a) and np.allclose(between(a, b, 1.0, centre), b, atol=1e-12)
    half = rotation_angle_deg(middle[:3, :3])
    assert np.isclose(half, rotation_angle_deg(b[:3, :3]) / 2)


def test_fused_views_know_their_members(ring):
    a, b = single(0, ring.surfaces[0]), single(1, ring.surfaces[1])
    guess = first_guess(a, b, ring.edges)
    assert guess is not None and likeness(a, b, ring.edges) == 0.5
    both = fuse(a, b, guess, 1.0)
    assert both.members == (0, 1) and np.array_equal(both.pose_of(0), np.eye(4))
    back = first_guess(single(2, ring.surfaces[2]), both, ring.edges)
    assert back is not None
    assert rotation_angle_deg(back[:3, :3].T @ (inverse(ring.T[2]) @ ring.T[0])[:3, :3]) < 8
    assert first_guess(single(4, ring.surfaces[4]), single(1, ring.surfaces[1]), ring.edges) is None
