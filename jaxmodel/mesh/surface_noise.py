"""How far vertices scatter about the smooth surface they were measured on, from the mesh itself."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import Adjacency

SAMPLES = 1500
NEIGHBOURS = 20
FEWEST = 60
"""Vertices below which a mesh is taken as exact: too few to tell scatter from shape."""
FLAP_QUARTILE = 0.3186
"""Lower quartile of |x| for a standard normal x."""
FIT_QUARTILE = 0.852
"""Lower quartile of the rms residual of 20 points about a fit of 6 parameters, in standard deviations."""


def surface_noise(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], shared: Adjacency) -> float:
    """Standard deviation of the vertices across the surface, in the mesh's unit.

    The smaller of two lower quartiles, so that up to three quarters of the places may lie on creases. Neighbouring
    triangles: the height of one's far corner over the other's plane, in standard deviations of that height; exact on
    flat parts, too large where the surface bends. Neighbouring vertices: residuals about local quadrics; free of bend,
    too large where the mesh is coarse.
    """
    corner = np.zeros(len(vertices), bool)
    corner[faces] = True
    used = np.flatnonzero(corner)
    if len(used) < FEWEST or len(shared.pairs) == 0:
        return 0.0
    return min(_flap_noise(vertices, faces, shared), quadric_noise(vertices[used]))


def _flap_noise(vertices: np.ndarray, faces: np.ndarray, shared: Adjacency) -> float:
    pairs = shared.pairs[:: max(1, len(shared.pairs) // (10 * SAMPLES))]
    ends = shared.edges[shared.pair_edge[:: max(1, len(shared.pairs) // (10 * SAMPLES))]]
    far = faces[pairs[:, 1]].sum(axis=1) - ends.sum(axis=1)
    a, b, c = (vertices[faces[pairs[:, 0], k]] for k in range(3))
    u, v, w = b - a, c - a, vertices[far] - a
    normal = np.cross(u, v)
    square = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)
    beta = np.einsum("ij,ij->i", np.cross(w, v), normal) / square
    gamma = np.einsum("ij,ij->i", np.cross(u, w), normal) / square
    height = np.einsum("ij,ij->i", w, normal) / np.sqrt(square)
    scale = np.sqrt(1 + beta**2 + gamma**2 + (1 - beta - gamma) ** 2)
    return float(np.quantile(np.abs(height / scale), 0.25)) / FLAP_QUARTILE


def quadric_noise(points: Float[np.ndarray, "n 3"], samples: int = SAMPLES) -> float:
    """Standard deviation of points about local quadrics, from the quieter quarter of them; 0 for too few points."""
    if len(points) < FEWEST:
        return 0.0
    tree = KDTree(points, balanced_tree=False, compact_nodes=False)
    seeds = points[:: max(1, len(points) // samples)]
    _, near = tree.query(seeds, k=NEIGHBOURS)
    local = points[near] - seeds[:, None]
    local = local - local.mean(axis=1, keepdims=True)
    _, frame = np.linalg.eigh(np.einsum("ski,skj->sij", local, local))
    z, v, u = np.moveaxis(np.einsum("ski,sij->skj", local, frame), 2, 0)
    size = np.maximum(np.sqrt((u**2).mean(axis=1, keepdims=True)), 1e-300)
    u, v = u / size, v / size
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    normal = terms.mT @ terms
    # a trace of damping: neighbours in a row leave some terms open
    normal += 1e-10 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(6)
    fitted = (terms @ np.linalg.solve(normal, terms.mT @ z[:, :, None]))[:, :, 0]
    scatter = np.sqrt(((z - fitted) ** 2).sum(axis=1) / (NEIGHBOURS - 6))
    return float(np.quantile(scatter, 0.25)) / FIT_QUARTILE
