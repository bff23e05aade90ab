"""Laws of blocks of lines: ordinates in pitches, pieces, averaging that leaves planes alone, tangents in space."""

import numpy as np
import pytest
from edge_maps import height_field
from known_views import pose

from jaxmodel.control_points.line_blocks import LineBlock, line_arrays, line_block
from jaxmodel.control_points.parabolas import fit
from jaxmodel.control_points.scan_lines import line_view
from jaxmodel.scan.known_solids import known_solid
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import scan_mesh


def block(image: RangeImage, sigma: float, axis: int = 1, lines: slice | None = None) -> LineBlock:
    view = line_view(image)
    joined = np.ones_like(image.valid)
    arrays = line_arrays(view, axis, np.full(image.valid.shape, sigma), (joined, joined))
    return line_block(arrays, lines or slice(0, arrays.distance.shape[0]))


def plane(projection, scale: float = 1.0) -> RangeImage:
    plate = known_solid("plate")
    image = scan_mesh(plate.vertices, plate.faces, Sensor(width=60, height=50, projection=projection), pose(2))
    return RangeImage(scale * image.points, image.valid, image.eye)


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
@pytest.mark.parametrize("sigma", [0.0, 0.1])
@pytest.mark.parametrize("axis", [0, 1])
def test_planes_stay_straight_when_lines_are_averaged(projection, sigma: float, axis: int) -> None:
    found = block(plane(projection), sigma, axis)
    parabolas = fit(found.data, found.pieces)
    assert (found.averaged.max() > 1) == (sigma > 0)
    # the inverse distance is not quite linear across a pinhole's lines
    assert np.sqrt(parabolas.misfit / np.add.reduceat(found.data.weight, found.pieces)).max() < 1e-4


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_tangents_lie_in_the_plane(projection) -> None:
    image = plane(projection)
    inside = (image.points[10, 40] - image.points[10, 10], image.points[40, 10] - image.points[10, 10])
    normal = np.cross(*inside)
    normal /= np.linalg.norm(normal)
    for axis in (0, 1):
        found = block(image, 0.0, axis)
        parabolas = fit(found.data, found.pieces)
        piece = np.repeat(np.arange(len(found.pieces)), parabolas.count)
        slope = np.sum(parabolas.take(piece).coefficients * parabolas.take(piece).derivatives(found.data.x), axis=0)
        tangents = found.tangents(slope, np.arange(len(slope)))
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        assert np.abs(tangents @ normal).max() < 1e-6


def test_the_unit_cancels() -> None:
    small, large = block(plane("pinhole"), 0.01), block(plane("pinhole", 1000.0), 10.0)
    for first, second in zip(small.data, large.data, strict=True):
        np.testing.assert_allclose(first, second, rtol=1e-9)


def test_averaging_lowers_the_noise_by_what_the_weights_say() -> None:
    rng = np.random.default_rng(0)
    found = block(height_field(2.0 * rng.normal(size=(60, 200))), 2.0)
    inside = (found.line > 3) & (found.line < 56)
    assert (found.averaged[inside] == 7).all()
    assert np.var(found.data.y[inside]) * found.data.weight[inside][0] == pytest.approx(1.0, rel=0.1)
    edge = found.line == 0
    assert (found.averaged[edge] == 1).all()


def test_lines_are_not_averaged_across_a_jump() -> None:
    z = np.zeros((30, 20))
    z[15:] = 50.0
    image = height_field(z)
    along, across = np.ones_like(image.valid), np.ones_like(image.valid)
    across[14] = False
    arrays = line_arrays(line_view(image), 1, np.full(z.shape, 2.0), (across, along))
    found = line_block(arrays, slice(0, 30))
    assert set(np.round(found.data.y, 9).tolist()) == {0.0, 50.0}


def test_a_block_of_some_lines_is_part_of_all_of_them() -> None:
    rng = np.random.default_rng(1)
    image = height_field(rng.normal(size=(40, 30)))
    whole, part = block(image, 1.0), block(image, 1.0, lines=slice(10, 20))
    inside = (whole.line >= 10) & (whole.line < 20)
    np.testing.assert_array_equal(part.line, whole.line[inside])
    np.testing.assert_array_equal(part.data.y, whole.data.y[inside])


def test_pieces_end_where_readings_are_not_joined() -> None:
    image = height_field(np.zeros((2, 10)))
    along = np.ones_like(image.valid)
    along[0, 3] = False
    arrays = line_arrays(line_view(image), 1, np.zeros((2, 10)), (np.ones_like(along), along))
    assert line_block(arrays, slice(0, 2)).pieces.tolist() == [0, 4, 10]
