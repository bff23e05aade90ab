"""One scan made ready to be registered with others: read once, held against any number of scans."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.control_points.local_features import point_features
from jaxmodel.control_points.subsample import voxel_subsample
from jaxmodel.geometry.nearest import build_table
from jaxmodel.register.evidence import Side, as_sample
from jaxmodel.register.refine_pair import Surface, surface_of
from jaxmodel.scan.cloud import Cloud, as_cloud, resolution
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
    """``whole``: every valid point with its normal; ``thin``: those that stand for the surface, in spatial balance;
    ``centre (3,)`` their mean, which ``side`` is about; ``size``: diagonal of the box; ``resolution`` of the whole;
    ``oriented``: normals face the sensor (a range image's do, a bare cloud's cannot be trusted to); ``described``
    rows of ``thin`` with their ``features``; ``surface``: the points inside the scan, for the exact fit.
    """

    whole: Cloud
    thin: Cloud
    centre: Float[np.ndarray, "3"]
    size: float
    resolution: float
    oriented: bool
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
    normals = cloud.normals if cloud.normals is not None else estimate_normals(points - centre)
    border = cloud.border if cloud.border is not None else estimate_borders(points - centre)
    whole = Cloud(points, np.asarray(normals, np.float64), np.asarray(border, bool))
    inner = whole.take(~whole.border) if (~whole.border).sum() >= 50 else whole
    thin = inner.take(voxel_subsample(inner.points, POINTS))
    sample = thin.take(voxel_subsample(thin.points, SAMPLE))
    sight = depth_map(scan, centre) if isinstance(scan, RangeImage) else no_depth_map()
    about = thin.points - centre
    side = Side(
        points=as_sample(about, POINTS),
        normals=as_sample(thin.normals, POINTS),
        table=build_table(about, CELLS, 1, 0.25 * float(np.ptp(about, axis=0).max())),
        sample=as_sample(sample.points - centre, SAMPLE),
        sample_normals=as_sample(sample.normals, SAMPLE),
        mask=np.arange(SAMPLE) < len(sample),
        sight=sight,
    )
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    described = voxel_subsample(thin.points, FEATURES)
    around = [point_features(thin.points, thin.normals, radius * length)[described] for radius in RADII]
    features = np.concatenate(around, axis=1)
    oriented = isinstance(scan, RangeImage)
    return ViewOfScan(
        whole, thin, centre, size, resolution(points), oriented, described, features, side, surface_of(inner)
    )
