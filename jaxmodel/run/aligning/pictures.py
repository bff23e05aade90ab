"""The merged cloud kept to be drawn, each view's points in a colour, and the graph of the views."""

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.control_points.subsample import voxel_subsample
from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.colours import number_colours
from jaxmodel.run.meshing.drawing_data import Drawn, keep

POINTS = 12_000


def keep_views(folder: RunDir, points: Float[np.ndarray, "n 3"], view: Int[np.ndarray, " n"]) -> None:
    """Points of all views in one frame, thinned, in their views' colours."""
    kept = voxel_subsample(points, POINTS)
    keep(folder, "merged", cloud=Drawn(points[kept], np.zeros((0, 3), np.int64), number_colours(view[kept])))
