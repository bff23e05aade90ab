"""What a surface looks like around each of its points, as numbers that no pose changes: FPFH, by Open3D on the CPU.

Fast point feature histograms (Rusu, Blodow and Beetz 2009) count how the normals around a point turn away from its
own.
"""

import numpy as np
import open3d
from jaxtyping import Float

NEIGHBOURS = 200
"""Points within the radius that are counted, at most."""


def point_features(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], radius: float
) -> Float[np.ndarray, "n 33"]:
    """FPFH of each point from those within ``radius`` (unit of the data), rows of length 1 (0 where none is near).

    Normals should face alike on both clouds that are to be compared: towards their sensors.
    """
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.asarray(points, np.float64)))
    cloud.normals = open3d.utility.Vector3dVector(np.asarray(normals, np.float64))
    around = open3d.geometry.KDTreeSearchParamHybrid(radius, NEIGHBOURS)
    features = np.asarray(open3d.pipelines.registration.compute_fpfh_feature(cloud, around).data).T
    length = np.linalg.norm(features, axis=1, keepdims=True)
    return features / np.where(length > 0, length, 1.0)
