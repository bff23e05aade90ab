"""What a surface is free to do: named, with its axis, in any frame and unit, with and without noise."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.io.datasets import MeshViews
from jaxmodel.register.degeneracy import Kind, freedom, normal_error
from jaxmodel.register.search import search
from jaxmodel.scan.cloud import as_cloud
from jaxmodel.scan.estimate import estimate_normals
from jaxmodel.scan.known_solids import known_solid
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.objects import OBJECTS, object_mesh
from jaxmodel.scan.sensor import Sensor

COUNT = 3000


def _surface(kind: Kind, draw: np.random.Generator) -> np.ndarray:
    """Points of a surface whose axis is z through the origin, or whose centre is the origin."""
    u, v = draw.uniform(-1, 1, (2, COUNT))
    if kind is Kind.PLANE:
        return np.column_stack([u, v, 0 * u])
    if kind is Kind.SPHERE:
        d = draw.normal(size=(2 * COUNT, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        return 0.7 * d[d[:, 2] > -0.2]
    if kind is Kind.PRISM:  # three sides of a corridor along z
        side = draw.integers(0, 3, COUNT)
        wall = np.choose(side, [0 * u - 0.5, u * 0.5, 0 * u + 0.5]), np.choose(side, [u * 0.5, 0 * u - 0.5, u * 0.5])
        return np.column_stack([*wall, 3 * v])
    angle = 0.55 * np.pi * u
    radius = 0.5 if kind is Kind.CYLINDER else 0.4 + 0.2 * np.sin(2.5 * v) + 0.1 * v
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), v])


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.006])
@pytest.mark.parametrize("kind", [Kind.PLANE, Kind.PRISM, Kind.CYLINDER, Kind.SPHERE, Kind.REVOLUTION])
def test_free_motions_are_named_with_their_axis(kind, noise):
    right = 0
    for seed in range(20):
        draw = np.random.default_rng([seed, int(kind)])
        points = _surface(kind, draw)
        points = points + noise * np.linalg.norm(np.ptp(points, axis=0)) * draw.normal(size=points.shape)
        R, t, unit = (
            Rotation.from_quat(draw.normal(size=4)).as_matrix(),
            5 * draw.normal(size=3),
            (1.0, 1000.0)[seed % 2],
        )
        moved = unit * (points @ R.T + t)
        found = freedom(moved, estimate_normals(moved, 12 if noise < 0.004 else 30))
        named = found.kind is kind
        if named and kind is not Kind.SPHERE:
            named = abs(found.axis @ R[:, 2]) > 0.99
        if named and kind in (Kind.CYLINDER, Kind.REVOLUTION):
            away = np.cross(found.point - unit * t, R[:, 2])
            named = np.linalg.norm(away) < 0.05 * unit
        if named and kind is Kind.SPHERE:
            named = np.linalg.norm(found.point - unit * t) < 0.05 * unit
        right += named
    assert right >= (20 if noise == 0 else 19)


@pytest.mark.parametrize("sigma", [0.0, 0.001])
@pytest.mark.parametrize("name", [name for name in OBJECTS if name != "block_steps"])
def test_objects_that_are_held_raise_no_alarm(name, sigma):
    """``block_steps`` is left out: some of its views show a prism and nothing else."""
    noise = Laser(sigma=sigma) if sigma else None
    views = MeshViews(name, object_mesh(name), (0, 120, 240), Sensor(width=140, height=140), noise)
    for view in views.names:
        cloud = as_cloud(views.scan(view))
        assert cloud.normals is not None and cloud.border is not None
        assert freedom(cloud.points[~cloud.border], cloud.normals[~cloud.border]).kind is Kind.HELD


def test_the_spectrum_is_the_sine_at_which_motions_leave_the_surface():
    """On a tilted pair of planes by hand: a slide along both is free, one across leaves both at 45 degrees."""
    u, v = np.random.default_rng(0).uniform(-1, 1, (2, 4000))
    side = np.sign(u)
    points = np.column_stack([u, v, -np.abs(u)])
    normals = np.column_stack([side, np.zeros(4000), np.ones(4000)]) / np.sqrt(2)
    found = freedom(points, normals)
    assert found.kind is Kind.PRISM and abs(found.axis[1]) > 0.9999
    assert np.isclose(found.spectrum[0], 0, atol=1e-6)
    assert (np.diff(found.spectrum) >= -1e-12).all() and found.spectrum[-1] <= 1 + 1e-9
    assert np.isclose(found.shifts[0], 0, atol=1e-5) and (found.turns > 0.1).all()


def test_the_error_of_normals_is_measured_on_curved_surfaces_too():
    draw = np.random.default_rng(3)
    d = draw.normal(size=(1500, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    for error in (0.02, 0.1):
        off = d + error * draw.normal(size=d.shape)
        off /= np.linalg.norm(off, axis=1, keepdims=True)
        sides = off * draw.choice([-1.0, 1.0], size=(1500, 1))
        assert np.isclose(normal_error(d, sides), error, rtol=0.25)


def test_too_few_points_are_refused():
    with pytest.raises(InputError, match="9 points are too few"):
        freedom(np.random.default_rng(0).normal(size=(9, 3)), np.tile([0.0, 0.0, 1.0], (9, 1)))


def test_a_search_says_what_its_scans_are_free_to_do():
    ball = MeshViews("ball", known_solid("ball"), (0, 60), Sensor(width=120, height=120), Laser(sigma=0.001))
    target, source = (ball.scan(name) for name in ball.names)
    found = search(target, source)
    assert found.freedom is not None and found.freedom.kind is Kind.SPHERE
    centre = np.linalg.inv(ball.T_world_scan(ball.names[0]))[:3, 3]
    assert np.linalg.norm(found.freedom.point - centre) < 0.01
