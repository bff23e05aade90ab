"""Views joined by pairs: wrong pairs are thrown out by their triangles, what hangs on nothing is said."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.se3 import inverse, rotation_angle_deg
from jaxmodel.register.multiview.pose_graph import fit_graph
from jaxmodel.register.multiview.view_graph import Edge, edge_of, placed, triangles
from jaxmodel.register.verdict import Found, SearchOutcome

COUNT = 8


def _world(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Poses of sensors around an object of size 1, the first the world, and the views' centres in their own frames."""
    draw = np.random.default_rng(seed)
    T = np.tile(np.eye(4), (COUNT, 1, 1))
    T[:, :3, :3] = Rotation.from_quat(draw.normal(size=(COUNT, 4))).as_matrix()
    centres = np.tile([0.0, 0.0, 2.5], (COUNT, 1)) + 0.05 * draw.normal(size=(COUNT, 3))
    T[:, :3, 3] = -np.einsum("nab,nb->na", T[:, :3, :3], centres) + 0.1 * draw.normal(size=(COUNT, 3))
    return inverse(T[0]) @ T, centres


def _edge(T: np.ndarray, a: int, b: int, noise: float, draw: np.random.Generator, probability: float = 0.95) -> Edge:
    off = np.eye(4)
    off[:3, :3] = Rotation.from_rotvec(noise * draw.normal(size=3)).as_matrix()
    true = inverse(T[a]) @ T[b]
    off[:3, 3] = noise * draw.normal(size=3) + true[:3, 3] - off[:3, :3] @ true[:3, 3]
    return Edge(a, b, off @ true, probability, (0.4, 0.35), 1e-3)


def _edges(T: np.ndarray, noise: float, wrong: int, seed: int = 1) -> list[Edge]:
    draw = np.random.default_rng(seed)
    pairs = [(a, b) for a in range(COUNT) for b in range(a + 1, COUNT) if (b - a) % COUNT <= 3 or b - a >= COUNT - 2]
    edges = [_edge(T, a, b, noise, draw) for a, b in pairs]
    for k in draw.choice(len(edges), wrong, replace=False):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_quat(draw.normal(size=4)).as_matrix()
        edges[k] = edges[k]._replace(T_target_source=edges[k].T_target_source @ turn, probability=0.99)
    return edges


def _errors(found: np.ndarray, T: np.ndarray, centres: np.ndarray) -> tuple[float, float]:
    turn = rotation_angle_deg(np.swapaxes(found[:, :3, :3], 1, 2) @ T[:, :3, :3])
    shift = np.einsum("nab,nb->na", (found - T)[:, :3, :3], centres) + (found - T)[:, :3, 3]
    return float(np.max(turn)), float(np.linalg.norm(shift, axis=1).max())


def test_exact_pairs_give_exact_poses():
    T, centres = _world()
    edges = _edges(T, 0.0, 0)
    found = placed(edges, centres, 1.0)
    assert (found.part == 0).all() and found.doubtful == () and len(found.tree) == COUNT - 1
    assert np.allclose(found.T_world_view, T, atol=1e-9)
    assert all(t.turn_deg < 1e-5 and t.shift < 1e-9 for t in triangles(edges, centres))


@pytest.mark.parametrize("wrong", [1, 4])
def test_wrong_pairs_that_look_sure_are_found_out(wrong):
    T, centres = _world()
    edges = _edges(T, 0.003, wrong)
    off = [e.T_target_source[:3, :3].T @ T[e.target, :3, :3].T @ T[e.source, :3, :3] for e in edges]
    bad = set(np.flatnonzero(np.asarray(rotation_angle_deg(np.stack(off))) > 10).tolist())
    assert len(bad) == wrong
    found = placed(edges, centres, 1.0)
    assert not bad & set(found.tree)
    fit = fit_graph(edges, found.T_world_view, centres, 1.0)
    assert set(np.argsort(-fit.residual)[:wrong].tolist()) == bad
    assert _errors(fit.T_world_view, T, centres)[0] < 0.5


def test_all_pairs_together_are_better_than_a_tree():
    T, centres = _world(3)
    before, after = [], []
    for seed in range(6):
        edges = _edges(T, 0.004, 0, seed)
        tree = placed(edges, centres, 1.0).T_world_view
        fit = fit_graph(edges, tree, centres, 1.0)
        assert fit.settled
        before.append(_errors(tree, T, centres))
        after.append(_errors(fit.T_world_view, T, centres))
    assert np.all(np.mean(after, axis=0) < 0.75 * np.mean(before, axis=0))


def test_neither_the_unit_nor_the_frames_matter_to_the_graph():
    T, centres = _world(4)
    edges = _edges(T, 0.004, 1)
    start = placed(edges, centres, 1.0).T_world_view
    plain = fit_graph(edges, start, centres, 1.0).T_world_view

    def large(M: np.ndarray) -> np.ndarray:
        out = np.array(M)
        out[..., :3, 3] *= 1000
        return out

    scaled = [e._replace(T_target_source=large(e.T_target_source)) for e in edges]
    found = fit_graph(scaled, large(start), 1000 * centres, 1000.0).T_world_view
    assert np.allclose(found, large(plain), atol=1e-4)


def test_parts_that_hang_together_are_numbered_by_size():
    T, centres = _world()
    draw = np.random.default_rng(0)
    edges = [_edge(T, 0, 1, 0.0, draw), *(_edge(T, a, a + 1, 0.0, draw) for a in (3, 4, 5))]
    found = placed(edges, centres, 1.0)
    assert found.part.tolist() == [1, 1, 2, 0, 0, 0, 0, 3]
    assert np.array_equal(found.T_world_view[3], np.eye(4))
    assert np.allclose(found.T_world_view[6], inverse(T[3]) @ T[6], atol=1e-9)


def test_only_what_is_believed_and_alone_becomes_an_edge():
    def found(outcome: SearchOutcome, probability: float) -> Found:
        return Found(np.eye(4), outcome, probability, (0.5, 0.4), 0.0, 0.0, 0.0, np.zeros((0, 4, 4)))

    assert len(edge_of(0, 1, found(SearchOutcome.FOUND, 0.9))) == 1
    for outcome in (SearchOutcome.SEVERAL, SearchOutcome.REFUSED):
        assert edge_of(0, 1, found(outcome, 0.9)) == []
    assert edge_of(0, 1, found(SearchOutcome.FOUND, 0.4)) == []
