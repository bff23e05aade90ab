"""The two scans of a pair as found, kept to be drawn: the target grey, the source orange."""

import numpy as np
from jaxtyping import Float

from jaxmodel.control_points.subsample import voxel_subsample
from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.drawing_data import Drawn, keep
from jaxmodel.run.pairs import Pair
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage, grid_triangles

GREY, ORANGE = (150, 160, 170), (225, 130, 40)
POINTS = 6000


def keep_pair(folder: RunDir, number: int, pair: Pair, T_target_source: Float[np.ndarray, "4 4"]) -> None:
    """Both scans in the target's frame: surfaces where they are images, else points."""
    target, source = _drawn(pair.target, np.eye(4), GREY), _drawn(pair.source, T_target_source, ORANGE)
    if len(target.faces) == 0 or len(source.faces) == 0:
        target, source = (Drawn(d.vertices, d.faces[:0], d.colours[:1]) for d in (target, source))
        target, source = (_points(d) for d in (target, source))
    both = Drawn(
        np.concatenate([target.vertices, source.vertices]),
        np.concatenate([target.faces, source.faces + len(target.vertices)]),
        np.concatenate([target.colours, source.colours]),
    )
    keep(folder, f"pair{number:03d}", both=both)


def _drawn(scan: RangeImage | Cloud, T: Float[np.ndarray, "4 4"], colour: tuple[int, int, int]) -> Drawn:
    points = scan.points[scan.valid] if isinstance(scan, RangeImage) else scan.points
    faces = grid_triangles(scan) if isinstance(scan, RangeImage) else np.zeros((0, 3), np.int64)
    moved = np.asarray(points, np.float64) @ T[:3, :3].T + T[:3, 3]
    return Drawn(moved, faces, np.tile(np.array(colour, np.uint8), (max(len(faces), 1), 1)))


def _points(drawn: Drawn) -> Drawn:
    kept = voxel_subsample(drawn.vertices, POINTS)
    return Drawn(drawn.vertices[kept], drawn.faces, np.repeat(drawn.colours, len(kept), axis=0))
