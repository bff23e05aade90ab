"""Rendered pictures against rays met with planes and boxes one by one, and the laws of occlusion and of pixels."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.scan.camera import Camera
from jaxmodel.scan.textured_scene import Face, box_faces, photograph, speckle
from jaxmodel.scan.virtual_scanner import look_at

PINHOLE = Camera(np.array([[90.0, 0, 41.0], [0, 88.0, 29.0], [0, 0, 1]]), np.zeros(0), 80, 60)
LENS = Camera(PINHOLE.K, np.array([-0.2, 0.05, 2e-3, -1e-3]), 80, 60)
BACKGROUND = 110.0
GREY = 1e-2  # rays are traced in single precision
SIZE = (0.4, 0.3, 0.2)
SHADES = np.array([20.0, 50.0, 80.0, 150.0, 190.0, 230.0])


def rays_of(camera: Camera) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    seen = camera.undistort(np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float))
    return np.append(seen, np.ones((len(seen), 1)), axis=1)


def random_pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return se3.compose(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))


def shaded_box(T_world_box: np.ndarray) -> list[Face]:
    return box_faces(T_world_box, SIZE, [np.full((2, 2), shade) for shade in SHADES])


def met_by_slabs(camera: Camera, T_box_camera: np.ndarray) -> np.ndarray:
    """The shade each ray meets: the box as three pairs of parallel planes (Kay and Kajiya 1986)."""
    start, directions = T_box_camera[:3, 3], rays_of(camera) @ T_box_camera[:3, :3].T
    with np.errstate(divide="ignore"):
        ends = np.stack([(np.array([0, 0, 0]) - start) / directions, (np.array(SIZE) - start) / directions])
    first, last = ends.min(axis=0), ends.max(axis=0)
    enter, leave = first.max(axis=1), last.min(axis=1)
    inside = enter < 0
    axis = np.where(inside, last.argmin(axis=1), first.argmax(axis=1))
    far = directions[np.arange(len(axis)), axis] > 0
    end = np.where(inside, far, ~far)  # the side with the larger coordinate is left going up, entered going down
    shade = SHADES[2 * axis + end]
    return np.where((enter <= leave) & (leave > 0), shade, BACKGROUND).reshape(camera.height, camera.width)


@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "lens"])
def test_a_plane_shows_what_each_ray_meets(camera):
    """A picture that is linear in its plane keeps its values when it is read bilinearly."""
    T_world_face, T_world_camera = random_pose(0), random_pose(1)
    T_world_camera = T_world_face @ look_at(np.array([0.7, -0.4, -1.1]), np.array([0.5, 0.35, 0.0]))
    size, shape = (1.0, 0.7), (71, 101)
    column, row = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    face = Face(T_world_face, size, 30.0 + 1.1 * column + 0.9 * row)
    normal, origin = T_world_face[:3, 2], T_world_face[:3, 3]
    directions = rays_of(camera) @ T_world_camera[:3, :3].T
    depth = ((origin - T_world_camera[:3, 3]) @ normal) / (directions @ normal)
    met = (T_world_camera[:3, 3] + depth[:, None] * directions - origin) @ T_world_face[:3, :2]
    inside = (depth > 0) & (met >= 0).all(axis=1) & (met <= size).all(axis=1)
    place = np.clip(met * [shape[1] / size[0], shape[0] / size[1]] - 0.5, 0, [shape[1] - 1, shape[0] - 1])
    expected = np.where(inside, 30.0 + place @ [1.1, 0.9], BACKGROUND).reshape(camera.height, camera.width)
    assert 0.2 < inside.mean() < 0.9
    np.testing.assert_allclose(photograph([face], camera, T_world_camera, BACKGROUND, samples=1), expected, atol=GREY)


@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "lens"])
@pytest.mark.parametrize("seed", range(4))
def test_a_box_hides_its_own_far_sides(camera, seed):
    T_world_box = random_pose(seed)
    away = Rotation.random(rng=np.random.default_rng(10 + seed)).apply([0, 0, 0.9])
    T_box_camera = look_at(np.array(SIZE) / 2 + away, np.array(SIZE) / 2)
    picture = photograph(shaded_box(T_world_box), camera, T_world_box @ T_box_camera, BACKGROUND, samples=1)
    expected = met_by_slabs(camera, T_box_camera)
    assert (expected != BACKGROUND).mean() > 0.05
    # rays that graze an edge may round to either side of it
    assert (np.abs(picture - expected) > GREY).mean() < 0.002


def test_inside_a_box_all_that_is_seen_is_its_inside():
    T_box_camera = look_at(np.array(SIZE) * [0.3, 0.6, 0.5], np.array([0.4, 0.05, 0.03]))
    picture = photograph(shaded_box(np.eye(4)), PINHOLE, T_box_camera, BACKGROUND, samples=1)
    expected = met_by_slabs(PINHOLE, T_box_camera)
    assert (expected != BACKGROUND).all() and len(np.unique(expected)) >= 3
    assert (np.abs(picture - expected) > GREY).mean() < 0.002


def test_the_nearer_face_is_seen_whatever_the_order():
    rng = np.random.default_rng(2)
    faces = shaded_box(np.eye(4)) + shaded_box(se3.compose(np.eye(3), np.array([0.1, 0.1, 0.35])))
    T = look_at(np.array([0.9, 0.8, 1.2]), np.array([0.2, 0.15, 0.2]))
    picture = photograph(faces, PINHOLE, T, samples=1)
    for _ in range(3):
        shuffled = [faces[k] for k in rng.permutation(len(faces))]
        np.testing.assert_array_equal(photograph(shuffled, PINHOLE, T, samples=1), picture)
    front = photograph(faces[6:], PINHOLE, T, background=-1.0, samples=1)
    hidden = (front >= 0) & (photograph(faces[:6], PINHOLE, T, background=-1.0, samples=1) >= 0)
    assert hidden.any()
    nearer = picture[hidden] == front[hidden]
    assert nearer.any()  # the upper box is nearer to a camera above both, where they overlap
    assert nearer.mean() > 0.99


def test_a_rigid_motion_of_everything_changes_nothing():
    faces = shaded_box(np.eye(4))
    T = look_at(np.array([0.7, 0.6, 0.8]), np.array(SIZE) / 2)
    moved = random_pose(3)
    other = photograph(shaded_box(moved), PINHOLE, moved @ T, samples=1)
    assert (np.abs(other - photograph(faces, PINHOLE, T, samples=1)) > GREY).mean() < 0.002


def test_a_pixel_is_the_mean_of_its_rays():
    """Three rays across a pixel are those of a camera with three times the pixels."""
    fine = Camera(np.array([[270.0, 0, 3 * 41.0 + 1], [0, 264.0, 3 * 29.0 + 1], [0, 0, 1]]), np.zeros(0), 240, 180)
    T = look_at(np.array([0.7, 0.6, 0.8]), np.array(SIZE) / 2)
    whole = photograph(shaded_box(np.eye(4)), fine, T, samples=1)
    blocks = whole.reshape(60, 3, 80, 3).mean(axis=(1, 3))
    picture = photograph(shaded_box(np.eye(4)), PINHOLE, T, samples=3)
    assert (np.abs(picture - blocks) > GREY).mean() < 0.01


@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "lens"])
def test_faces_behind_the_camera_and_no_faces_leave_the_background(camera):
    away = look_at(np.array([0.2, 0.15, 1.0]), np.array([0.2, 0.15, 2.0]))
    for faces in ([], shaded_box(np.eye(4))):
        np.testing.assert_array_equal(photograph(faces, camera, away, 77.0), np.full((60, 80), 77.0))


def test_a_box_has_six_faces_on_its_sides():
    faces = shaded_box(np.eye(4))
    corners = np.concatenate(
        [
            se3.apply(face.T_world_face, np.array([[0, 0, 0], [face.size[0], 0, 0], [0, face.size[1], 0]]))
            for face in faces
        ]
    )
    assert len(faces) == 6
    assert np.isin(np.round(corners, 12), [0.0, *SIZE]).all()
    areas = sorted(face.size[0] * face.size[1] for face in faces)
    np.testing.assert_allclose(areas, np.repeat([0.06, 0.08, 0.12], 2))


def test_speckle_is_repeatable_and_fills_its_range():
    one, again, other = (speckle(np.random.default_rng(seed), (90, 120)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 10
    assert one.shape == (90, 120) and one.min() == pytest.approx(20.0) and one.max() == pytest.approx(235.0)
    # the smallest blob asked for is 4 pixels: larger ones alone are smoother
    coarse = speckle(np.random.default_rng(5), (90, 120), octaves=(32,))
    assert np.abs(np.diff(coarse, axis=1)).max() < np.abs(np.diff(one, axis=1)).max()


def test_what_cannot_be_pictured_is_refused():
    picture = np.zeros((4, 5))
    for values, message in (
        ((np.eye(4), (0.0, 1.0), picture), "sides must be lengths > 0"),
        ((np.eye(4), (1.0, np.nan), picture), "sides must be lengths > 0"),
        ((np.eye(4), (1.0, 1.0), np.zeros((1, 5))), r"at least 2 x 2 finite numbers, not \(1, 5\)"),
        ((np.eye(4), (1.0, 1.0), np.full((4, 5), np.nan)), "at least 2 x 2 finite numbers"),
        ((np.diag([2.0, 1.0, 1.0, 1.0]), (1.0, 1.0), picture), "must be rigid"),
    ):
        with pytest.raises(InputError, match=message):
            Face(*values)
    with pytest.raises(InputError, match="at least one ray"):
        photograph([], PINHOLE, np.eye(4), samples=0)
    with pytest.raises(InputError, match=r"at least 1 x 1 pixel, not \(0, 5\)"):
        speckle(np.random.default_rng(0), (0, 5))
