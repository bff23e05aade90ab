"""Ball pivoting: topology of known surfaces, one sheet from layers, the account of passes, and unfit input."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.mesh import ball_pivot, ball_pivoting, quality
from jaxmodel.mesh.distance import surface_distance
from jaxmodel.scan.triangle_mesh import icosphere


def sphere(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def torus(count: int, minor: float = 0.35) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    u, v, draw = rng.random((3, 4 * count))
    even = draw < (1 + minor * np.cos(2 * np.pi * v)) / (1 + minor)
    u, v = 2 * np.pi * u[even][:count], 2 * np.pi * v[even][:count]
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=1)
    return np.stack([np.cos(u), np.sin(u), 0 * u], axis=1) + minor * normals, normals


def grid(rows: int = 8, columns: int = 10) -> np.ndarray:
    x, y = np.meshgrid(np.arange(float(rows)), np.arange(float(columns)), indexing="ij")
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)


UP = np.array([0.0, 0.0, 1.0])
TORUS, TORUS_NORMALS = torus(4000)


def test_a_sphere_is_closed_and_faces_outward() -> None:
    points = sphere(3000)
    made = ball_pivoting(points, points)
    found = quality(made.mesh)
    assert found.closed
    assert (found.euler, found.components, found.vertices) == (2, 1, 3000)
    assert len(made.unused) == len(made.bad_normals) == len(made.turned) == 0
    assert found.turned_pairs == 0
    corners = made.mesh.vertices[made.mesh.faces]
    volume = np.einsum("ma,ma->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert 4.1 < volume < 4 * np.pi / 3  # positive: counter-clockwise seen from outside


def test_a_torus_has_its_handle_and_passes_add_up() -> None:
    made = ball_pivoting(TORUS, TORUS_NORMALS)
    found = quality(made.mesh)
    assert found.closed
    assert (found.euler, found.components) == (0, 1)
    radii = [p.radius for p in made.passes]
    assert radii == sorted(radii)
    lengths = [p.border_length for p in made.passes]
    assert lengths == sorted(lengths, reverse=True)
    assert sum(p.triangles for p in made.passes) + made.closing - made.dropped == found.triangles
    assert made.closing >= 0 and made.dropped >= 0
    np.testing.assert_array_equal(made.mesh.vertices, TORUS[made.source])


@pytest.mark.parametrize(("scale", "shift"), [(1000.0, 0.0), (1e-3, 5.0)])
def test_unit_and_origin_do_not_matter(scale: float, shift: float) -> None:
    here = ball_pivoting(TORUS, TORUS_NORMALS)
    there = ball_pivoting(TORUS * scale + shift, TORUS_NORMALS)
    found, expected = quality(there.mesh), quality(here.mesh)
    assert found.closed
    assert (found.Q_equ, found.Q_nor, found.area / scale**2) == pytest.approx(
        (expected.Q_equ, expected.Q_nor, expected.area), rel=1e-3
    )
    assert [p.radius for p in there.passes] == pytest.approx([scale * p.radius for p in here.passes], rel=1e-6)


def test_a_regular_grid_is_meshed_once() -> None:
    found = quality(ball_pivot(grid(), np.tile(UP, (80, 1))))
    assert (found.triangles, found.border_edges, found.crowded_edges) == (2 * 7 * 9, 32, 0)
    assert found.area == pytest.approx(63.0)


@pytest.mark.parametrize("offset", [1e-3, 0.05, 0.1])
def test_four_offset_views_of_a_plane_become_one_sheet(offset: float) -> None:
    rng = np.random.default_rng(2)
    points = np.concatenate([grid() + offset * rng.normal(size=3) for _ in range(4)])
    made = ball_pivoting(points, np.tile(UP, (320, 1)))
    found = quality(made.mesh)
    assert made.thinned > 0
    assert (found.components, found.border_loops, found.euler, found.crowded_edges) == (1, 1, 1, 0)
    # one triangle over any place: the area is that of its own shadow, and no more than the views cover
    corners = made.mesh.vertices[made.mesh.faces]
    shadow = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert (shadow > 0).all()
    assert 0.85 * 63 < shadow.sum() < 63 + 4 * 17 * offset


def test_a_noisy_sphere_is_one_sheet_near_the_true_one() -> None:
    points = sphere(12_000)
    noisy = points * (1 + 0.005 * np.random.default_rng(3).normal(size=(len(points), 1)))
    made = ball_pivoting(noisy, points)
    found = quality(made.mesh)
    assert found.closed
    assert (found.euler, found.components) == (2, 1)
    distance = surface_distance(made.mesh, icosphere(6), samples=5000)
    assert distance.mean < 0.005 / 2  # the noise averaged out, more than a chord's height included


def test_both_sides_of_a_thin_wall_stay_apart() -> None:
    rng = np.random.default_rng(4)
    low, high = (np.c_[10 * rng.random((3000, 2)), height + 0.03 * rng.normal(size=3000)] for height in (0.0, 1.0))
    made = ball_pivoting(np.concatenate([low, high]), np.repeat([-UP, UP], 3000, axis=0))
    heights = made.mesh.vertices[made.mesh.faces][:, :, 2]
    assert made.thinned > 0
    assert np.ptp(heights, axis=1).max() < 0.5
    assert {0, 1} == set(np.round(heights.mean(axis=1)).astype(int))


def test_without_normals_they_are_made_and_it_is_said() -> None:
    points = sphere(2000)
    made = ball_pivoting(points)
    assert made.estimated and quality(made.mesh).closed
    assert quality(ball_pivot(points)).euler == 2


def test_inconsistent_signs_are_turned_or_refused() -> None:
    sign = np.where(np.random.default_rng(5).random(len(TORUS)) < 0.3, -1.0, 1.0)
    made = ball_pivoting(TORUS, TORUS_NORMALS * sign[:, None])
    np.testing.assert_array_equal(made.turned, np.flatnonzero(sign < 0))
    assert quality(made.mesh).turned_pairs == 0
    with pytest.raises(InputError, match="normals are on the other side"):
        ball_pivot(TORUS, TORUS_NORMALS * sign[:, None])


def test_sensor_positions_decide_the_side() -> None:
    points = sphere(2000)
    eyes = np.concatenate([3 * points, np.ones((2000, 1))], axis=1)
    made = ball_pivoting(points, -points, eyes=eyes)
    assert len(made.turned) == 2000
    assert (np.einsum("na,na->n", made.normals, made.mesh.vertices) > 0).all()


def test_single_bad_normals_are_left_out_and_listed() -> None:
    normals = TORUS_NORMALS.copy()
    normals[5], normals[6] = np.nan, 0.0
    normals[7] = np.cross(normals[7], [1.0, 2.0, 3.0])
    normals[8] *= -1
    made = ball_pivoting(TORUS, normals)
    np.testing.assert_array_equal(made.bad_normals, [5, 6, 7])
    np.testing.assert_array_equal(made.turned, [8])
    assert not np.isin([5, 6, 7], made.source).any()
    with pytest.raises(InputError, match="3 of 4000 normals are zero, not finite or stray"):
        ball_pivot(TORUS, normals)


def test_duplicates_are_merged() -> None:
    points = sphere(1000)
    twice = np.concatenate([points, points[::-1]])
    found = quality(ball_pivot(twice, twice))
    assert found.closed and found.vertices == 1000


def test_small_parts_are_dropped_on_request() -> None:
    large, small = sphere(2000), 0.1 * sphere(200) + np.array([3.0, 0, 0])
    points, normals = np.concatenate([large, small]), np.concatenate([large, (small - [3, 0, 0]) * 10])
    both = ball_pivoting(points, normals, radii=[0.06, 0.12])
    assert quality(both.mesh).components == 2
    one = ball_pivoting(points, normals, radii=[0.06, 0.12], smallest_part=0.05)
    assert quality(one.mesh).components == 1 and quality(one.mesh).vertices == 2000


def test_a_hole_is_closed_only_where_points_lie() -> None:
    points = sphere(4000)
    cap = points[points[:, 2] < 0.8]
    found = quality(ball_pivot(cap, cap))
    assert (found.border_loops, found.euler, found.components) == (1, 1, 1)


@pytest.mark.parametrize(
    ("points", "normals", "options", "message"),
    [
        (TORUS, 0 * TORUS, {}, "4000 of 4000 normals are zero"),
        (TORUS, sphere(4000), {}, "neighbouring normals are within 45°"),
        (TORUS, TORUS_NORMALS[:-1], {}, "normals of shape"),
        (np.linspace(0, 1, 40)[:, None] * [1.0, 2.0, 3.0], None, {}, "lie on one line"),
        (np.where(np.arange(40)[:, None] == 7, np.nan, TORUS[:40]), None, {}, "point 7 .*finite"),
        (np.ones((9, 3)), None, {}, "all 9 points are equal"),
        (TORUS, TORUS_NORMALS, {"radii": [9.0]}, "too large.* would do"),
        (TORUS, TORUS_NORMALS, {"radii": []}, "positive radii"),
        (TORUS, TORUS_NORMALS, {"radii": [-1.0]}, "positive radii"),
    ],
)
def test_unfit_input_is_refused(
    points: np.ndarray, normals: np.ndarray | None, options: dict[str, list[float]], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        ball_pivoting(points, normals, **options)  # pyright: ignore[reportArgumentType]


def test_a_radius_too_small_names_one_that_works() -> None:
    with pytest.raises(InputError, match="would do") as refused:
        ball_pivoting(TORUS, TORUS_NORMALS, radii=[1e-4])
    named = float(str(refused.value).split("a radius of ")[1].split(" ")[0])
    assert quality(ball_pivot(TORUS, TORUS_NORMALS, radii=[named])).triangles > 0
