"""Which points drive a registration: subsamples of the measured points, or vertices of the decimated scan."""

from jaxmodel.control_points.decimate import mesh_control_points
from jaxmodel.control_points.select import ControlPoints, Subsample, Vertices, select
from jaxmodel.control_points.subsample import farthest_point_subsample, random_subsample, voxel_subsample

__all__ = [
    "ControlPoints",
    "Subsample",
    "Vertices",
    "farthest_point_subsample",
    "mesh_control_points",
    "random_subsample",
    "select",
    "voxel_subsample",
]
