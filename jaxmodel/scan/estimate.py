"""Normals and borders of a cloud without a grid, from its points' neighbourhoods."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree


def estimate_normals(points: Float[np.ndarray, "n 3"], neighbours: int = 12) -> Float[np.ndarray, "n 3"]:
    """Unit normals: the direction of least spread of each point's ``neighbours`` nearest points.

    The sign is arbitrary (pointing away from the cloud's centroid), which point-to-plane distances do not see.
    """
    normals, _, _ = _local_frames(points, neighbours)
    outward = np.sum(normals * (points - points.mean(axis=0)), axis=1, keepdims=True)
    return np.where(outward < 0, -normals, normals)


def estimate_borders(
    points: Float[np.ndarray, "n 3"], neighbours: int = 16, gap_deg: float = 120.0
) -> Bool[np.ndarray, " n"]:
    """Whether a point lies on the rim of the sampled surface.

    Seen in its tangent plane, such a point has a sector of at least ``gap_deg`` without any of its nearest neighbours.
    """
    _, tangents, offsets = _local_frames(points, neighbours)
    u, v = (np.einsum("nka,na->nk", offsets, tangents[:, axis]) for axis in range(2))
    angles = np.sort(np.arctan2(v, u), axis=1)
    gaps = np.diff(np.concatenate([angles, angles[:, :1] + 2 * np.pi], axis=1), axis=1)
    return np.degrees(gaps.max(axis=1)) > gap_deg


def _local_frames(points: np.ndarray, neighbours: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals (n, 3), two tangents (n, 2, 3) and the offsets (n, k, 3) to the nearest neighbours."""
    count = min(neighbours + 1, len(points))
    _, index = KDTree(points).query(points, k=count)
    index = np.asarray(index)
    offsets = points[index[:, 1:]] - points[:, None, :]
    centred = points[index] - points[index].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nka,nkb->nab", centred, centred))
    return vectors[:, :, 0], np.swapaxes(vectors[:, :, 1:], 1, 2), offsets
