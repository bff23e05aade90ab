"""One scan made ready to be registered with others: read once, held against any number of scans."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.control_points.local_features import point_features
from jaxmodel.control_points.subsample import voxel_subsample
from jaxmodel.geometry.nearest import build_table
from jaxmodel.register.evidence import Side, as_sample
from jaxmodel.register.refine_pair import Surface, surface_of
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.depth_map import depth_map, no_depth_map
from jaxmodel.scan.estimate import estimate_borders, estimate_normals
from jaxmodel.scan.range_image import RangeImage

POINTS, SAMPLE, CELLS = 8192, 1024, 64
"""Of each scan: points that stand for its surface, those that are held against another scan, cells of the table."""
FEATURES = 4096
"""Points whose surroundings are described."""
RADII = (0.08, 0.16)
"""Of those surroundings, in the length of the search."""


class ViewOfScan(eqx.Module):
    """``whole``: every valid point with its normal; ``thin``: those that stand for the surface, evenly spread;
    ``centre (3,)`` the mean of the whole, which ``side`` is about; ``size``: diagonal of its box; ``described`` rows of
    ``thin`` with their ``features``; ``surface``: the points inside the scan, for the exact fit.
    """

    whole: Cloud
    thin: Cloud
    centre: Float[np.ndarray, "3"]
    size: float
    described: Int[np.ndarray, " f"]
    features: Float[np.ndarray, "f d"]
    side: Side
    surface: Surface


def size_of(scan: RangeImage | Cloud | np.ndarray, what: str = "the scan") -> float:
    """Diagonal of a scan's box, unit of the data. Raises ``InputError`` for clouds that cannot be registered."""
    return float(np.linalg.norm(np.ptp(as_cloud(scan, what).points, axis=0)))


def view_of(scan: RangeImage | Cloud | np.ndarray, length: float, what: str = "the scan") -> ViewOfScan:
    """Everything one scan contributes to a search; ``length``, what all scans searched together measure lengths in,
    is about their size. Raises ``InputError`` for clouds that cannot be registered.
    """
    cloud = as_cloud(scan, what)
    points = np.asarray(cloud.points, np.float64)
    centre = points.mean(axis=0)
    normals = np.asarray(estimate_normals(points - centre) if cloud.normals is None else cloud.normals, np.float64)
    border = np.asarray(estimate_borders(points - centre) if cloud.border is None else cloud.border, bool)
    inner = ~border if (~border).sum() >= 50 else np.ones(len(points), bool)
    rows = np.flatnonzero(inner)[voxel_subsample(points[inner], POINTS)]
    asked = rows[voxel_subsample(points[rows], SAMPLE)]
    about = points[rows] - centre
    side = Side(
        points=as_sample(about, POINTS),
        normals=as_sample(normals[rows], POINTS),
        table=build_table(about, CELLS, 1, 0.25 * float(np.ptp(about, axis=0).max())),
        sample=as_sample(points[asked] - centre, SAMPLE),
        sample_normals=as_sample(normals[asked], SAMPLE),
        mask=np.arange(SAMPLE) < len(asked),
        sight=depth_map(scan, centre) if isinstance(scan, RangeImage) else no_depth_map(),
    )
    described = voxel_subsample(points[rows], FEATURES)
    around = [point_features(points[rows], normals[rows], radius * length)[described] for radius in RADII]
    return ViewOfScan(
        whole=Cloud(points, normals, border),
        thin=Cloud(points[rows], normals[rows], border[rows]),
        centre=centre,
        size=float(np.linalg.norm(np.ptp(points, axis=0))),
        described=described,
        features=np.concatenate(around, axis=1),
        side=side,
        surface=surface_of(Cloud(points[inner], normals[inner])),
    )
