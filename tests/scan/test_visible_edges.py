"""True visible edges: against what can be counted by hand, and against the ray caster (an oracle)."""

import numpy as np
import pytest

from jaxmodel.scan.known_solids import before_a_wall, known_solid
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, project
from jaxmodel.scan.triangle_mesh import ObjectMesh
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh, turntable_poses
from jaxmodel.scan.visible_edges import jump_pixels, visible_edges

SENSOR = Sensor(width=200, height=200)
CORNER = look_at(np.array([1.9, 1.5, 1.7]), np.zeros(3))


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_a_box_seen_from_a_corner_shows_nine_of_its_twelve_edges(projection) -> None:
    sensor = Sensor(width=200, height=200, projection=projection)
    edges = visible_edges(known_solid("box"), sensor, CORNER)
    np.testing.assert_allclose(edges.angle_deg, 90.0)
    # three edges between seen faces meet in the near corner, six make the outline
    mesh = known_solid("box")
    pixels = project(sensor, (mesh.vertices - CORNER[:3, 3]) @ CORNER[:3, :3])
    near = pixels[np.argmax(mesh.vertices.sum(axis=1))]
    ends = [pixels[np.argmin(np.abs(mesh.vertices - corner).sum(axis=1))] for corner in
            (np.array([-0.5, 0.35, 0.25]), np.array([0.5, -0.35, 0.25]), np.array([0.5, 0.35, -0.25]))]  # fmt: skip
    length = sum(np.linalg.norm(end - near) for end in ends)
    assert edges.crease.sum() == pytest.approx(length / 0.25, rel=0.05)
    assert (~edges.crease).sum() > edges.crease.sum()
    far = pixels[np.argmin(mesh.vertices.sum(axis=1))]
    assert np.linalg.norm(edges.pixels - far, axis=1).min() > 5


def test_ridges_are_positive_and_valleys_negative() -> None:
    edges = visible_edges(known_solid("stepped_block"), SENSOR, look_at(np.array([2.0, -1.5, 1.6]), np.zeros(3)))
    assert set(np.sign(edges.angle_deg[edges.crease]).tolist()) == {1.0, -1.0}
    np.testing.assert_allclose(np.abs(edges.angle_deg), 90.0)
    assert (edges.angle_deg[~edges.crease] > 0).all()  # an outline is a ridge


def test_facets_of_a_curved_face_are_no_edges() -> None:
    edges = visible_edges(known_solid("cylinder"), SENSOR, CORNER)
    radius = []
    for angle in np.linspace(0, 2 * np.pi, 400):
        for height in (-0.5, 0.5):
            radius.append((0.375 * np.cos(angle), 0.375 * np.sin(angle), height))
    rims = project(SENSOR, (np.array(radius) - CORNER[:3, 3]) @ CORNER[:3, :3])
    off = np.linalg.norm(edges.pixels[:, None] - rims, axis=2).min(axis=1)
    assert off.max() < 0.6
    assert len(visible_edges(known_solid("ball"), SENSOR, CORNER).pixels) == 0


@pytest.mark.parametrize("name", ["box", "stepped_block", "cylinder", "roof45"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_sample_lies_where_the_ray_caster_hits_the_edge(name: str, seed: int) -> None:
    """Oracle: Open3D's rays around the sample meet the surface at the sample's distance, nothing nearer."""
    rng = np.random.default_rng(seed)
    mesh = before_a_wall(known_solid(name))
    eye = rng.normal(size=3)
    eye[2] = abs(eye[2]) + 0.3
    T = look_at(3.0 * eye / np.linalg.norm(eye), np.zeros(3))
    # so fine that the readings around a crease are close together on faces seen at a slant too
    fine = Sensor(width=1600, height=1600)
    edges = visible_edges(mesh, fine, T)
    image = scan_mesh(mesh.vertices, mesh.faces, fine, T)
    depth = np.where(image.valid, image.points[..., 2], np.inf)
    column, row = np.clip(np.round(edges.pixels).astype(int), 0, 1599).T
    padded = np.pad(depth, 1, constant_values=np.inf)
    around = np.stack([padded[row + i, column + j] for i in range(3) for j in range(3)])
    assert np.isfinite(around).any(axis=0).mean() > 0.99
    # a crease has the surface on all sides of it, so its neighbours are all about as far away
    inside = edges.crease & (column > 0) & (column < 1599) & (row > 0) & (row < 1599)
    spread = np.ptp(around[:, inside], axis=0)
    assert np.median(spread) < 0.1


def test_an_edge_behind_another_surface_is_not_seen() -> None:
    box = known_solid("box")
    hidden = ObjectMesh(box.vertices * 0.2 + np.array([0.0, 0.0, -0.6]), box.faces)
    both = ObjectMesh(np.concatenate([box.vertices, hidden.vertices]), np.concatenate([box.faces, hidden.faces + 8]))
    above = look_at(np.array([0.0, 0.0, 3.0]), np.zeros(3))
    np.testing.assert_allclose(visible_edges(both, SENSOR, above).pixels, visible_edges(box, SENSOR, above).pixels)
    alone = visible_edges(hidden, SENSOR, above)
    assert len(alone.pixels) > 100


def test_edges_outside_the_image_are_not_seen() -> None:
    narrow = Sensor(width=200, height=200, field_of_view_deg=8.0)
    edges = visible_edges(known_solid("box"), narrow, CORNER)
    assert ((edges.pixels >= -0.5) & (edges.pixels <= 199.5)).all()
    assert 0 < edges.crease.sum() < len(visible_edges(known_solid("box"), SENSOR, CORNER).pixels)


def test_jumps_of_an_image_by_hand() -> None:
    z = np.zeros((6, 12))
    z[:, 5:] = 5.0
    z[2, 8] = np.nan
    z[3, 9:11] = np.nan
    points = np.stack([*np.meshgrid(np.arange(12.0), np.arange(6.0)), -z], axis=-1)
    image = RangeImage(points, np.isfinite(z), np.array([0.0, 0.0, 1.0, 0.0]))
    expected = np.zeros((6, 12), dtype=bool)
    expected[:, 4:6] = True
    np.testing.assert_array_equal(jump_pixels(image, 1.0), expected)
    assert not jump_pixels(image, 1.3).any()
    z[:, 4] = np.nan  # across a missing reading the limit is larger
    gap = RangeImage(np.where(np.isfinite(z)[..., None], points, np.nan), np.isfinite(z), image.eye)
    assert not jump_pixels(gap, 1.0).any()
    assert jump_pixels(gap, 0.8)[:, [3, 5]].all()


def test_jumps_of_a_pinhole_scale_with_the_distance() -> None:
    mesh = before_a_wall(known_solid("box"))
    pose = turntable_poses([30], 3.0, 60)[0]
    image = scan_mesh(mesh.vertices, mesh.faces, SENSOR, pose)
    found = jump_pixels(image, 1 / SENSOR.focal_px)
    assert found.sum() > 200
    larger = RangeImage(1000.0 * image.points, image.valid, image.eye)
    np.testing.assert_array_equal(jump_pixels(larger, 1 / SENSOR.focal_px), found)
