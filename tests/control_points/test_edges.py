"""What the map of edges must show: known edges found and labelled right, nothing on smooth surfaces, hard inputs."""

from functools import lru_cache
from pathlib import Path

import jax
import numpy as np
import pytest
from edge_maps import height_field
from known_views import SENSOR, ball_image, pose, view
from scipy.ndimage import binary_dilation, distance_transform_edt

from jaxmodel.control_points.edge_score import EdgeScore, edge_score
from jaxmodel.control_points.edges import EdgeKind, EdgeMap, EdgeOptions, find_edges
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.known_solids import known_solid
from jaxmodel.scan.noise import Laser, Profilometer
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, pixel_rays
from jaxmodel.scan.virtual_scanner import scan_mesh, turntable_poses

SOLIDS = ["box", "stepped_block", "cylinder"]
ROOFS = ["roof30", "roof45", "roof60"]
SIDE_BY_SIDE, ABOVE_EACH_OTHER = 1, 2


def same(first: EdgeMap, second: EdgeMap) -> bool:
    parts = ("kind", "far", "orientation", "valid")
    return all(np.array_equal(getattr(first, part), getattr(second, part)) for part in parts)


def scores(names: list[str], sigma: float, seeds: range) -> list[EdgeScore]:
    found = []
    for name in names:
        for wall in (False, True):
            for seed in seeds:
                image, truth = view(name, sigma, seed, wall)
                found.append(edge_score(find_edges(image), truth))
    return found


def tent(slope: float = 1.0, sigma: float = 0.0, seed: int = 0) -> RangeImage:
    """A ridge down the middle column, seen from above, pixel spacing 1."""
    column = np.broadcast_to(np.arange(61.0), (41, 61))
    z = -slope * np.abs(column - 30.2)
    return height_field(z + sigma * np.random.default_rng(seed).normal(size=z.shape))


# -- known edges


@pytest.mark.parametrize("sigma", [0.0, 0.001, 0.002])
@pytest.mark.parametrize("name", SOLIDS)
def test_edges_of_known_solids_at_little_noise(name: str, sigma: float) -> None:
    for score in scores([name], sigma, range(2)):
        assert score.precision >= 0.95
        assert score.recall >= 0.90
        assert not score.crease_recall < 0.90  # NaN where no crease lies inside the surface
        assert not score.labels < 0.95


@pytest.mark.parametrize("name", SOLIDS)
def test_edges_of_known_solids_at_one_percent_noise(name: str) -> None:
    for score in scores([name], 0.01, range(2)):
        assert score.precision >= 0.80
        assert score.recall >= 0.50
        assert not score.crease_recall < 0.50
        assert not score.labels < 0.80


@pytest.mark.parametrize("sigma", [0.0, 0.001, 0.002])
@pytest.mark.parametrize("name", ROOFS)
def test_shallow_ridges_at_little_noise(name: str, sigma: float) -> None:
    found = scores([name], sigma, range(3))
    assert min(score.precision for score in found) >= 0.95
    assert np.nanmean([score.crease_recall for score in found]) >= 0.90


@pytest.mark.slow
def test_precision_and_recall_fall_slowly_with_noise() -> None:
    for sigma, least in ((0.0, 0.995), (0.002, 0.99), (0.005, 0.97), (0.01, 0.95)):
        found = scores(SOLIDS, sigma, range(4))
        assert np.mean([score.precision for score in found]) >= least
        assert np.mean([score.recall for score in found]) >= least


@pytest.mark.parametrize("bend", [30.5, 45, 60])
def test_the_angle_is_that_between_the_faces(bend: float) -> None:
    name = f"roof{int(bend)}"
    image, truth = view(name, 0.0005, 3)
    found = find_edges(image)
    ridge = found.angle_deg[found.kind == EdgeKind.CREASE]
    assert truth.crease.any()
    angles = ridge[np.abs(ridge - bend) < 20]  # the eaves bend by other angles
    assert len(angles) > 50
    assert np.median(angles) == pytest.approx(bend, abs=1.5)


def test_ridges_are_positive_and_valleys_negative() -> None:
    for flip in (1.0, -1.0):
        found = find_edges(tent(flip, sigma=0.05))
        angles = found.angle_deg[found.kind == EdgeKind.CREASE]
        assert len(angles) >= 35
        assert np.sign(angles).tolist() == [flip] * len(angles)
        assert np.abs(np.abs(angles) - 90).max() < 10
        assert np.isnan(found.angle_deg[found.kind != EdgeKind.CREASE]).all()


def test_a_crease_is_one_pixel_wide_and_beside_the_ridge() -> None:
    found = find_edges(tent(0.7))
    creases = np.argwhere(found.kind == EdgeKind.CREASE)
    assert creases[:, 0].tolist() == list(range(1, 40))
    assert set(creases[:, 1].tolist()) <= {30, 31}
    assert (found.orientation[found.kind == EdgeKind.CREASE] & SIDE_BY_SIDE).all()


# -- smooth surfaces


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
@pytest.mark.parametrize("sigma", [0.0, 0.002, 0.01])
def test_a_sphere_has_no_crease_and_its_rim_is_depth_or_border(projection, sigma: float) -> None:
    sensor = Sensor(width=200, height=200, projection=projection)
    for seed in range(3):
        image = ball_image(sigma, seed, sensor)
        found = find_edges(image)
        assert np.count_nonzero(found.kind == EdgeKind.CREASE) == 0
        inside = distance_transform_edt(image.valid)
        rim = image.valid & binary_dilation(~image.valid)
        assert (found.kind[rim] != EdgeKind.NONE).all()
        assert np.asarray(inside)[found.kind == EdgeKind.DEPTH].max(initial=0.0) < 8
        assert np.count_nonzero(found.kind == EdgeKind.DEPTH) <= 12


@pytest.mark.parametrize("sigma", [0.0, 0.002, 0.01])
def test_a_plane_has_nothing_but_the_border_of_the_image(sigma: float) -> None:
    plate = known_solid("plate")
    for seed in range(3):
        image = scan_mesh(
            plate.vertices, plate.faces, SENSOR, pose(seed), Laser(sigma=sigma, unit="data"), jax.random.key(seed)
        )
        found = find_edges(image)
        edge = np.ones(image.valid.shape, dtype=bool)
        edge[1:-1, 1:-1] = False
        beside = image.valid & (edge | binary_dilation(~image.valid))
        np.testing.assert_array_equal(found.kind == EdgeKind.BORDER, beside)
        np.testing.assert_array_equal(found.kind != EdgeKind.NONE, beside)


@pytest.mark.parametrize("wall", [1.0, 2.0, 3.5, 4.0, 5.0, 8.0])
def test_a_wide_view_of_a_flat_wall_has_no_crease(wall: float) -> None:
    """A panorama of half a turn: rays of equal steps in angle, not in tangent."""
    turn, lift = np.meshgrid(np.linspace(-1.5, 1.5, 500), np.linspace(-0.5, 0.5, 40))
    rays = np.stack([np.sin(turn) * np.cos(lift), np.sin(lift), np.cos(turn) * np.cos(lift)], axis=-1)
    distance = np.minimum(wall / np.maximum(rays[..., 2], 1e-3), 3.0 / np.maximum(rays[..., 0], 1e-3))
    found = find_edges(RangeImage(distance[..., None] * rays, np.ones(turn.shape, dtype=bool)))
    corner = np.arctan2(3.0, wall)  # two walls at right angles meet there
    creases = np.argwhere(found.kind == EdgeKind.CREASE)
    assert set(creases[:, 0].tolist()) == set(range(1, 39))
    assert np.abs(turn[0, creases[:, 1]] - corner).max() < 0.01
    angles = found.angle_deg[found.kind == EdgeKind.CREASE]
    assert np.abs(angles + 90).max() < 3


# -- jumps


def test_both_sides_of_a_jump_are_marked_and_the_far_one_is_told() -> None:
    z = np.zeros((30, 40))
    z[8:22, 10:30] = 12.0
    found = find_edges(height_field(z))
    high = z > 0
    inner = high & np.asarray(binary_dilation(~high), bool)
    outer = ~high & np.asarray(binary_dilation(high), bool)
    np.testing.assert_array_equal(found.kind == EdgeKind.DEPTH, inner | outer)
    np.testing.assert_array_equal(found.far, outer)
    assert (found.orientation[15, [9, 10, 29, 30]] == SIDE_BY_SIDE).all()
    assert (found.orientation[[7, 8, 21, 22], 20] == ABOVE_EACH_OTHER).all()


@pytest.mark.parametrize("height", [1.5, 3.0, 6.0])
def test_a_step_smaller_than_a_jump_is_depth_too(height: float) -> None:
    z = np.zeros((30, 40))
    z[:, 20:] = height
    found = find_edges(height_field(z))
    assert (found.kind[1:-1, 19:21] == EdgeKind.DEPTH).all()
    assert found.far[1:-1, 19].all() and not found.far[1:-1, 20].any()
    assert np.count_nonzero(found.kind[1:-1, 1:-1]) == 2 * 28


@pytest.mark.parametrize("seed", range(12))
def test_mixed_points_of_a_real_beam_are_found(seed: int) -> None:
    found, _, mixed = beam(seed)
    assert mixed.sum() > 300
    assert (~found.valid & mixed).sum() >= 0.9 * mixed.sum()
    assert (found.kind[~found.valid] == EdgeKind.NONE).all()


@pytest.mark.parametrize("seed", range(12))
def test_mixed_points_of_a_real_beam_are_removed_and_jumps_stay_in_place(seed: int) -> None:
    """A jump that runs exactly between two footprints lies in neither, so the rays tell where it is."""
    found, outline, mixed = beam(seed)
    distance = rays_of_a_beam(seed)
    jump = np.zeros(distance.shape, dtype=bool)
    for axis in (0, 1):
        lines, marked = np.swapaxes(distance, 0, axis), np.swapaxes(jump, 0, axis)
        apart = np.abs(np.diff(lines, axis=0)) > 0.2
        marked[:-1] |= apart
        marked[1:] |= apart
    everywhere = outline | jump.reshape(200, 4, 200, 4).any(axis=(1, 3))
    assert (~found.valid & ~np.asarray(binary_dilation(mixed, np.ones((3, 3))), bool)).sum() <= 0.01 * mixed.sum()
    assert np.asarray(distance_transform_edt(~everywhere))[found.kind == EdgeKind.DEPTH].max() <= 2


@lru_cache
def rays_of_a_beam(seed: int) -> np.ndarray:
    """Distances along 800 x 800 rays to a box before nothing nearer than 4."""
    solid = known_solid("box")
    image = scan_mesh(solid.vertices, solid.faces, Sensor(width=800, height=800), pose(seed))
    distance = np.linalg.norm(image.points, axis=-1)
    return np.where(np.isnan(distance), 4.0, distance)


@lru_cache
def beam(seed: int) -> tuple[EdgeMap, np.ndarray, np.ndarray]:
    """A map, the true outline and the mixed readings where each reading is the mean over a footprint of 4 x 4 rays."""
    distance = rays_of_a_beam(seed).reshape(200, 4, 200, 4)
    points = distance.mean(axis=(1, 3))[..., None] * pixel_rays(SENSOR).directions
    near, far = distance.min(axis=(1, 3)), distance.max(axis=(1, 3))
    share = (distance > 0.5 * (near + far)[:, None, :, None]).mean(axis=(1, 3))
    outline = far - near > 0.2
    found = find_edges(RangeImage(points, np.ones((200, 200), dtype=bool)))
    return found, outline, outline & (share > 0.1) & (share < 0.9)


# -- laws


@pytest.mark.parametrize("sigma", [0.0, 0.003])
def test_the_unit_does_not_matter(sigma: float) -> None:
    image = view("stepped_block", sigma, 1, wall=True).image
    plain = find_edges(image)
    for scale in (1000.0, 1 / 1024):
        scaled = find_edges(RangeImage(scale * image.points, image.valid, image.eye))
        assert same(plain, scaled)
        assert scaled.noise == pytest.approx(scale * plain.noise)


@pytest.mark.parametrize("sigma", [0.0, 0.005])
def test_a_transposed_image_gives_the_transposed_map(sigma: float) -> None:
    image = view("box", sigma, 2, wall=True).image
    plain = find_edges(image)
    turned = find_edges(RangeImage(image.points.transpose(1, 0, 2), image.valid.T, image.eye))
    np.testing.assert_array_equal(turned.kind, plain.kind.T)
    np.testing.assert_array_equal(turned.far, plain.far.T)
    np.testing.assert_array_equal(turned.valid, plain.valid.T)
    swapped = (plain.orientation & 1) << 1 | plain.orientation >> 1
    np.testing.assert_array_equal(turned.orientation, swapped.T)
    np.testing.assert_allclose(turned.angle_deg, plain.angle_deg.T)


def test_a_mirrored_image_gives_the_mirrored_map_but_for_a_pixel() -> None:
    image = view("stepped_block", 0.002, 4).image
    plain = find_edges(image)
    mirrored = find_edges(RangeImage(image.points[:, ::-1], image.valid[:, ::-1], image.eye))
    for kind in (EdgeKind.CREASE, EdgeKind.DEPTH, EdgeKind.BORDER):
        first, second = plain.kind == kind, mirrored.kind[:, ::-1] == kind
        assert (binary_dilation(first, np.ones((3, 3)), iterations=2) | ~second).mean() > 0.999
        assert (binary_dilation(second, np.ones((3, 3)), iterations=2) | ~first).mean() > 0.999


def test_a_moved_sensor_frame_changes_nothing() -> None:
    image = view("box", 0.002, 3).image
    shift = np.array([10.0, -20.0, 5.0])
    moved = RangeImage(image.points + shift, image.valid, np.append(shift, 1.0))
    assert same(find_edges(image), find_edges(moved))


@pytest.mark.parametrize("sigma", [0.0005, 0.003, 0.01])
def test_the_noise_is_estimated_from_the_image(sigma: float) -> None:
    plate = known_solid("plate")
    pose_above = turntable_poses([30], 3.0, 90)[0]
    image = scan_mesh(
        plate.vertices, plate.faces, SENSOR, pose_above, Laser(sigma=sigma, unit="data"), jax.random.key(0)
    )
    assert find_edges(image).noise == pytest.approx(sigma, rel=0.05)


def test_depth_in_steps_makes_no_edge() -> None:
    """A profilometer rounds: most third differences are then 0 on a surface that faces it."""
    image = scan_mesh(
        known_solid("plate").vertices,
        known_solid("plate").faces,
        SENSOR,
        turntable_poses([0], 3.0, 75)[0],
        Profilometer(step=0.001, sigma=0.0, unit="data"),
        jax.random.key(1),
    )
    assert np.count_nonzero(find_edges(image).kind[1:-1, 1:-1]) == 0


def test_missing_readings_inside_a_surface_are_bridged() -> None:
    image = tent(1.0, sigma=0.02)
    rng = np.random.default_rng(3)
    lost = rng.random(image.valid.shape) < 0.03
    points = np.where(lost[..., None], np.nan, image.points)
    found = find_edges(RangeImage(points, image.valid & ~lost, image.eye))
    whole = find_edges(image)
    # beside the image's edge a lost reading leaves its neighbour at the border
    assert np.count_nonzero(found.kind[2:-2, 2:-2] == EdgeKind.BORDER) == 0
    rows = np.unique(np.argwhere(found.kind == EdgeKind.CREASE)[:, 0])
    assert len(rows) >= 37
    assert np.count_nonzero(found.kind == EdgeKind.CREASE) <= np.count_nonzero(whole.kind == EdgeKind.CREASE) + 3


def test_options_reach_the_map() -> None:
    image = tent(0.3, sigma=0.01)  # bends by 33 degrees
    assert np.count_nonzero(find_edges(image).kind == EdgeKind.CREASE) > 30
    assert np.count_nonzero(find_edges(image, EdgeOptions(angle_deg=40.0)).kind == EdgeKind.CREASE) == 0
    z = np.zeros((20, 30))
    z[:, 15:] = 9.0
    assert find_edges(height_field(z)).far.any()
    assert not find_edges(height_field(z), EdgeOptions(jump=20.0, step=20.0)).far.any()


# -- hard inputs


@pytest.mark.parametrize("field", ["jump", "angle_deg", "step", "significance", "gain"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_options_that_make_no_sense_are_refused(field: str, value: float) -> None:
    with pytest.raises(InputError, match=field):
        EdgeOptions(**{field: value})


def test_a_scan_without_a_grid_is_refused() -> None:
    with pytest.raises(InputError, match="range image"):
        find_edges(Cloud(points=np.random.default_rng(0).normal(size=(50, 3))))  # type: ignore[arg-type]


@pytest.mark.parametrize("shape", [(0, 5), (1, 1), (7, 9)])
def test_an_image_with_no_valid_pixel_has_no_edge(shape: tuple[int, int]) -> None:
    found = find_edges(RangeImage(np.full((*shape, 3), np.nan), np.zeros(shape, dtype=bool)))
    assert found.kind.shape == shape
    assert not found.kind.any() and not found.valid.any() and found.noise == 0.0


@pytest.mark.parametrize("column", [False, True])
def test_a_single_line_is_segmented_along_itself(column: bool) -> None:
    line = tent().points[20:21]
    points = line.transpose(1, 0, 2) if column else line
    found = find_edges(RangeImage(points, np.ones(points.shape[:2], dtype=bool), tent().eye))
    kind = found.kind.ravel()
    assert kind[[0, -1]].tolist() == [EdgeKind.BORDER] * 2
    assert (found.kind == EdgeKind.BORDER).all()  # every pixel of one line is at the image's edge
    assert (found.orientation.ravel()[1:-1] == (SIDE_BY_SIDE if column else ABOVE_EACH_OTHER)).all()


def test_isolated_pixels_are_borders() -> None:
    image = tent()
    lonely = np.zeros(image.valid.shape, dtype=bool)
    lonely[::7, ::9] = True
    points = np.where(lonely[..., None], image.points, np.nan)
    found = find_edges(RangeImage(points, lonely, image.eye))
    np.testing.assert_array_equal(found.kind == EdgeKind.BORDER, lonely)
    np.testing.assert_array_equal(found.kind != EdgeKind.NONE, lonely)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_readings_that_are_no_numbers_count_as_missing(value: float) -> None:
    image = tent(sigma=0.05)
    points = image.points.copy()
    points[10:14, 20:26] = value
    valid = image.valid.copy()
    valid[10:14, 20:26] = False
    clean = RangeImage(np.where(valid[..., None], points, np.nan), valid, image.eye)
    assert same(find_edges(RangeImage(points, image.valid, image.eye)), find_edges(clean))


ROW, COLUMN = np.indices((20, 30)).astype(float)
NONE = np.zeros((20, 30))
ODD_POINTS = {
    "a plane through the sensor": np.stack([COLUMN - 15, ROW - 10, NONE], axis=-1),
    "opposite rays in every line": np.stack([COLUMN - 14.5, NONE, NONE], axis=-1),
    "one ray for all": (1 + COLUMN + ROW)[..., None] * np.array([1.0, 2.0, 3.0]),
    "one ray for each row": np.stack([0.1 * ROW, NONE, 1 + NONE], axis=-1) * (1 + COLUMN)[..., None],
    "one point": np.ones((20, 30, 3)),
    "all at the sensor": np.zeros((20, 30, 3)),
    "infinite": np.full((20, 30, 3), np.inf),
    "one reading a line": np.where(np.eye(20, 30, dtype=bool)[..., None], 1 + NONE[..., None], np.nan),
    "one reading": np.where((ROW == 3)[..., None] & (COLUMN == 4)[..., None], 5 + NONE[..., None], np.nan),
    "one reading far out": np.where((ROW == 3)[..., None] & (COLUMN == 4)[..., None], 1e8, 1 + NONE[..., None]),
}


@pytest.mark.parametrize("name", ODD_POINTS)
@pytest.mark.parametrize("eye", [(0, 0, 0, 1), (0, 0, 1, 0), (0, 0, 1, 1)])
def test_points_that_no_sensor_gives_divide_by_nothing(name: str, eye: tuple[int, ...]) -> None:
    points = ODD_POINTS[name] * np.ones(3)
    with np.errstate(all="raise"):
        found = find_edges(RangeImage(points, np.isfinite(points).all(axis=-1), np.array(eye, dtype=float)))
    assert not found.valid[~np.isfinite(points).all(axis=-1)].any()
    assert (found.kind[~found.valid] == EdgeKind.NONE).all()


def test_points_on_a_coarse_lattice_divide_by_nothing() -> None:
    """Equal points, equal and opposite rays, readings at the sensor: all of them in every image."""
    rng = np.random.default_rng(0)
    for _ in range(40):
        shape = rng.integers(1, 12, 2)
        image = RangeImage(rng.choice([-1.0, 0.0, 0.5, 1.0], size=(*shape, 3)), rng.random(shape) < 0.8)
        with np.errstate(all="raise"):
            assert not find_edges(image).valid[~image.valid].any()


def test_a_reading_at_the_sensor_counts_as_missing() -> None:
    image = view("box", 0.0, 1).image
    points = image.points.copy()
    points[100, 100] = 0.0
    assert not find_edges(RangeImage(points, image.valid, image.eye)).valid[100, 100]


def test_single_precision_is_enough() -> None:
    image = view("box", 0.002, 1, wall=True).image
    single = find_edges(RangeImage(image.points.astype(np.float32), image.valid, image.eye))
    double = find_edges(image)
    assert (single.kind == double.kind).mean() > 0.9995


# -- real scans


@pytest.mark.data
def test_the_real_bunny(data_dir: Path) -> None:
    from jaxmodel.io.scans import load_scan

    image = load_scan(data_dir / "stanford_bunny" / "data" / "bun000.ply")
    assert isinstance(image, RangeImage)
    found = find_edges(image)
    count = np.bincount(found.kind.ravel(), minlength=4)
    assert 500 < count[EdgeKind.CREASE] < 0.05 * image.valid.sum()
    assert count[EdgeKind.DEPTH] > 300 and count[EdgeKind.BORDER] > 800
    assert 0.00005 < found.noise < 0.00015  # metre; the scanner's depth resolution is about 0.1 mm
    assert (image.valid & ~found.valid).sum() < 0.005 * image.valid.sum()
