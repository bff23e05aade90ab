"""Laws of scan lines: distances and pitch of both projections, planes straight along every line, noise."""

import numpy as np
import pytest
from edge_maps import height_field
from known_views import pose

from jaxmodel.control_points.scan_lines import blocks, line_frames, line_view, local_noise, noise, readings
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.known_solids import known_solid
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, pixel_rays
from jaxmodel.scan.virtual_scanner import scan_mesh


def plane(sensor: Sensor) -> RangeImage:
    plate = known_solid("plate")
    return scan_mesh(plate.vertices, plate.faces, sensor, pose(1))


def everywhere_joined(image: RangeImage) -> tuple[np.ndarray, np.ndarray]:
    return np.ones_like(image.valid), np.ones_like(image.valid)


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_distance_and_pitch_are_the_sensors(projection) -> None:
    sensor = Sensor(width=90, height=60, projection=projection)
    image = plane(sensor)
    view = line_view(image)
    rays = pixel_rays(sensor)
    from_sensor = np.sum((image.points - rays.origins) * rays.directions, axis=-1)
    np.testing.assert_allclose(view.distance, from_sensor, rtol=1e-12)
    # the rays of a pinhole stand closer together away from its axis
    assert view.pitch[0] == pytest.approx(1 / sensor.focal_px, rel=0.05)
    assert view.pitch[1] == pytest.approx(1 / sensor.focal_px, rel=0.05)


def test_pitches_of_rows_and_columns_are_told_apart() -> None:
    image = height_field(np.zeros((20, 30)))
    stretched = RangeImage(image.points * np.array([3.0, 1.0, 1.0]), image.valid, image.eye)
    assert line_view(stretched).pitch == pytest.approx((1.0, 3.0))


def test_the_pitch_of_a_single_line_stands_for_both() -> None:
    image = height_field(np.zeros((1, 30)), scale=0.5)
    assert line_view(image).pitch == pytest.approx((0.5, 0.5))


def test_a_cloud_is_refused() -> None:
    with pytest.raises(InputError, match="range image"):
        line_view(Cloud(points=np.zeros((5, 3))))


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_plane_is_straight_along_every_line(projection, axis: int) -> None:
    image = plane(Sensor(width=90, height=60, projection=projection, field_of_view_deg=70.0))
    view = line_view(image)
    points, distance = (np.swapaxes(part, 0, 1 - axis) for part in (view.points, view.distance))
    line = np.repeat(np.arange(distance.shape[0]), distance.shape[1])
    frames = line_frames(points.reshape(-1, 3), distance.ravel(), line, view.pitch[axis], view.toward)
    y = -distance.ravel() if view.toward is not None else 1 / (distance.ravel() * frames.cosine)
    np.testing.assert_array_equal(frames.group, line)
    for number in range(0, distance.shape[0], 7):
        x, height = frames.x[line == number], y[line == number]
        straight = np.polynomial.Polynomial.fit(x, height, 1)
        np.testing.assert_allclose(straight(x), height, rtol=1e-9)


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_along_is_the_direction_of_the_line(projection) -> None:
    sensor = Sensor(width=40, height=30, projection=projection)
    view = line_view(plane(sensor))
    line = np.repeat(np.arange(30), 40)
    frames = line_frames(view.points.reshape(-1, 3), view.distance.ravel(), line, view.pitch[1], view.toward)
    direction = frames.along / np.linalg.norm(frames.along, axis=1, keepdims=True)
    np.testing.assert_allclose(direction, np.broadcast_to([1.0, 0.0, 0.0], direction.shape), atol=1e-9)


def test_a_full_turn_is_cut_into_sectors_where_every_ray_lies_well_before_its_middle() -> None:
    turn = np.tile(np.linspace(0, 2 * np.pi, 400, endpoint=False), 2)
    points = 3.0 * np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=1)
    line = np.repeat([0, 1], 400)
    frames = line_frames(points, np.full(800, 3.0), line, 2 * np.pi / 400, None)
    assert frames.cosine.min() > 0.5
    assert 4 <= len(np.unique(frames.group[line == 0])) <= 5
    cuts = [np.flatnonzero(np.diff(frames.group[line == number])) for number in (0, 1)]
    assert np.abs(cuts[0][:, None] - cuts[1]).min() > 20
    assert (np.diff(frames.x)[np.diff(frames.group) == 0] > 0).all()


def test_readings_tell_gaps_within_reach_and_line_ends() -> None:
    valid = np.array([[1, 1, 0, 1, 0, 0, 1, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]], dtype=bool)
    flat = readings(valid)
    assert flat.pixel.tolist() == [0, 1, 3, 6, 10, 11, 21]
    assert flat.gap.tolist() == [1, 2, 3, 0, 0, 0, 0]


@pytest.mark.parametrize("shape", [(0, 7), (1, 100_000), (3, 20_000), (1000, 3), (5, 0)])
def test_blocks_cover_every_line_once(shape: tuple[int, int]) -> None:
    rows = [row for block in blocks(shape) for row in range(block.start, block.stop)]
    assert rows == list(range(shape[0]))


@pytest.mark.parametrize("sigma", [0.01, 0.3])
def test_noise_is_recovered_whatever_lies_under_it(sigma: float) -> None:
    rng = np.random.default_rng(0)
    row, column = np.indices((120, 150))
    z = 20 * np.sin(row / 40) + 0.8 * column + 30.0 * (column > 70)
    image = height_field(z + sigma * rng.normal(size=z.shape))
    assert noise(line_view(image)) == pytest.approx(sigma, rel=0.05)


def test_no_noise_where_there_are_no_four_readings_in_a_row() -> None:
    z = np.full((9, 9), np.nan)
    z[::2, ::2] = 1.0
    assert noise(line_view(height_field(z))) == 0.0
    assert noise(line_view(height_field(np.zeros((12, 12))))) == 0.0


def test_local_noise_follows_a_change_and_heeds_no_edge() -> None:
    rng = np.random.default_rng(1)
    z = 0.2 * rng.normal(size=(90, 120))
    z[:, 60:] *= 3.0
    z[45:] += 40.0
    image = height_field(z)
    view = line_view(image)
    joined = everywhere_joined(image)
    joined[0][44] = False
    found = local_noise(view, joined, noise(view))
    assert np.median(found[:, 20:45]) == pytest.approx(0.2, rel=0.1)
    assert np.median(found[:, 75:100]) == pytest.approx(0.6, rel=0.1)
    assert found[40:50, 20:45].max() < 0.3


def test_local_noise_is_the_common_one_where_nothing_is_known() -> None:
    image = height_field(np.zeros((8, 8)))
    none = np.zeros_like(image.valid)
    np.testing.assert_array_equal(local_noise(line_view(image), (none, none), 0.7), np.full((8, 8), 0.7))
