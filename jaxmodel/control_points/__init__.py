"""Which points drive a registration: subsamples of the measured points, mesh vertices, or points on 3D contours."""

from jaxmodel.control_points.contour_points import RankedContours, contour_control_points
from jaxmodel.control_points.contours import find_contours
from jaxmodel.control_points.decimate import mesh_control_points
from jaxmodel.control_points.edges import EdgeKind, EdgeMap, find_edges
from jaxmodel.control_points.polylines import approximate
from jaxmodel.control_points.select import Contours, ControlPoints, SplitVertices, Subsample, Vertices, select
from jaxmodel.control_points.split_mesh import SplitMesh, split_control_points, split_mesh
from jaxmodel.control_points.subsample import farthest_point_subsample, random_subsample, voxel_subsample
from jaxmodel.control_points.triangle_splitting import SplitOptions

__all__ = [
    "Contours",
    "ControlPoints",
    "EdgeKind",
    "EdgeMap",
    "RankedContours",
    "SplitMesh",
    "SplitOptions",
    "SplitVertices",
    "Subsample",
    "Vertices",
    "approximate",
    "contour_control_points",
    "farthest_point_subsample",
    "find_contours",
    "find_edges",
    "mesh_control_points",
    "random_subsample",
    "select",
    "split_control_points",
    "split_mesh",
    "voxel_subsample",
]
