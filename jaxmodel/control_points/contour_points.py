"""Control points on the 3D contours of a range image (thesis §2.4, §2.9.6; MISSION control points A)."""

from collections.abc import Sequence

import numpy as np

from jaxmodel.control_points.contours import ALL_KINDS, ContourOptions, find_contours
from jaxmodel.control_points.edges import EdgeKind, EdgeMap, EdgeOptions, find_edges
from jaxmodel.control_points.polylines import importance
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.range_image import RangeImage


def contour_control_points(
    image: RangeImage,
    count: int,
    kinds: Sequence[EdgeKind] = (EdgeKind.CREASE,),
    edge_options: EdgeOptions = EdgeOptions(),
    contour_options: ContourOptions = ContourOptions(),
) -> Cloud:
    """Control points on the contours of a range image: the ``count`` points that matter most to their shape.

    Prefer them to mesh vertices on objects with sharp edges. Creases alone suit free forms and cylinders, whose depth
    edges move with the sensor; on polyhedra a depth edge or the outline is a crease of another view, so all three
    kinds serve there (thesis §2.9.6). Of a depth edge only the near side is taken: the far one is the shadow of the
    near one, no edge of the surface it lies on.

    Args:
        image: the range image, sensor frame.
        count: how many points, at least 3; reached exactly where the contours have as many pixels, else all of them.
        kinds: which edges.
        edge_options, contour_options: thresholds of the edges and of the contours.

    Returns:
        Cloud of measured points in the sensor frame, in row-major order, with their normals. The border flags are all
        False where depth or border points are asked for, which turns the border filter of the pairing off.

    Raises:
        InputError: ``count`` is below 3, the image is not a valid cloud, or it has fewer than 3 contour points. That
            is a fault of the input: nothing has been registered yet, and another kind of control points is the cure.
    """
    check_count(count)
    return RankedContours(image, kinds, edge_options, contour_options).most_important(count)


class RankedContours:
    """The contour points of one range image in the order of their importance; any number of them costs next to nothing.

    Arguments and errors are those of ``contour_control_points``.
    """

    def __init__(
        self,
        image: RangeImage,
        kinds: Sequence[EdgeKind] = (EdgeKind.CREASE,),
        edge_options: EdgeOptions = EdgeOptions(),
        contour_options: ContourOptions = ContourOptions(),
    ) -> None:
        self._measured = as_cloud(image, "the range image")
        self._creases_alone = set(kinds) == {EdgeKind.CREASE}
        edges = _without_far_sides(find_edges(image, edge_options))
        contours = find_contours(image, edges, kinds, contour_options)
        if sum(map(len, contours.chains)) < 3:
            words = ", ".join(kind.name.lower() for kind in ALL_KINDS if kind in kinds)
            raise InputError(
                f"the range image has no {words} contour to take control points from ({contours.outcome.sentence}): "
                "use the kind subsample or vertices"
            )
        w = image.valid.shape[1]
        pixel = np.concatenate([chain.pixels for chain in contours.chains]) @ [w, 1]
        value = np.concatenate(importance(contours))
        # A junction is in several chains: its pixel counts once, as what it is at most.
        order = np.lexsort((pixel, -value))
        order = order[np.sort(np.unique(pixel[order], return_index=True)[1])]
        self._points = (np.cumsum(image.valid.ravel()) - 1)[pixel[order]]

    def most_important(self, count: int) -> Cloud:
        """The first ``count`` of them, all if there are fewer, in row-major order."""
        check_count(count)
        cloud = self._measured.take(np.sort(self._points[:count]))
        if self._creases_alone:
            return cloud
        return Cloud(points=cloud.points, normals=cloud.normals, border=np.zeros(len(cloud), dtype=bool))


def check_count(count: int) -> None:
    """Fewer than three points fix no motion: refused."""
    if count < 3:
        raise InputError(f"count is {count}, expected at least 3 control points")


def _without_far_sides(edges: EdgeMap) -> EdgeMap:
    """The map without the far sides of its jumps."""
    return EdgeMap(
        kind=np.where(edges.far, np.int8(EdgeKind.NONE), edges.kind),
        far=np.zeros_like(edges.far),
        orientation=edges.orientation,
        angle_deg=edges.angle_deg,
        valid=edges.valid,
        noise=edges.noise,
    )
