"""Views fitted onto a model: flat faces held by contours, free forms by their surface; what the fit says of itself."""

from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.register.onto_model import FitOutcome, Model, Parts, fit_onto, model_of, parts_of
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh

SENSOR = Sensor(120, 120, field_of_view_deg=40.0)
PIXEL = 2 * 1.6 * np.tan(np.deg2rad(20.0)) / 120
"""On the object, in its size: contours are no finer."""


class Pair:
    """Two views of one object, from two azimuths."""

    def __init__(self, mesh: Any, azimuths: tuple[float, float]) -> None:
        vertices = np.asarray(mesh.vertices, np.float64)
        middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        self.size = 2 * float(np.linalg.norm(vertices - middle, axis=1).max())
        self.poses, self.views = [], []
        for azimuth in azimuths:
            a, e = np.deg2rad([azimuth, 35.0])
            eye = middle + 1.6 * self.size * np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
            T = look_at(eye, middle)
            image = scan_mesh(vertices, np.asarray(mesh.faces, np.int32), SENSOR, T)
            self.poses.append(T)
            self.views.append(parts_of(image))
        self.model = model_of(self.views[0].moved(self.poses[0]))

    def off(self, seed: int, degrees: float, shift: float) -> np.ndarray:
        """The second pose, turned about the middle of what it sees and shifted in the size."""
        rng = np.random.default_rng(seed)
        axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        centre = self.views[1].moved(self.poses[1]).points.mean(axis=0)
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec(np.deg2rad(degrees) * axis).as_matrix()
        T[:3, 3] = centre - T[:3, :3] @ centre + shift * self.size * way
        return T @ self.poses[1]

    def error(self, T: np.ndarray) -> tuple[float, float]:
        """Degrees, and the way of the middle of what is seen in the size."""
        centre = self.views[1].points.mean(axis=0)
        turn = Rotation.from_matrix(T[:3, :3] @ self.poses[1][:3, :3].T).magnitude()
        return float(np.rad2deg(turn)), float(np.linalg.norm((T - self.poses[1])[:3] @ [*centre, 1])) / self.size


@pytest.fixture(scope="module")
def block() -> Pair:
    """Of a box, seen so that both views share one side and the top."""
    return Pair(trimesh.creation.box((1.0, 0.8, 0.6)), (40.0, 130.0))


@pytest.fixture(scope="module")
def gourd() -> Pair:
    return Pair(object_mesh("gourd"), (30.0, 65.0))


def without_contours(parts: Parts) -> Parts:
    return Parts(parts.points, parts.normals, np.zeros((0, 3)), np.zeros((0, 3)))


@pytest.mark.parametrize("seed", range(5))
def test_flat_faces_are_held_by_contours(block: Pair, seed: int) -> None:
    fit = fit_onto(block.model, block.views[1], block.off(seed, 3.0, 0.02), block.size)
    degrees, shift = block.error(fit.T_model_view)
    assert fit.outcome is FitOutcome.FITTED and degrees < 0.5 and shift < PIXEL


@pytest.mark.parametrize("seed", range(5))
def test_free_forms_are_fitted_well_below_a_pixel(gourd: Pair, seed: int) -> None:
    fit = fit_onto(gourd.model, gourd.views[1], gourd.off(seed, 3.0, 0.02), gourd.size)
    degrees, shift = gourd.error(fit.T_model_view)
    assert fit.outcome is FitOutcome.FITTED and degrees < 0.1 and shift < 0.0005
    assert 0.3 < fit.shared < 1


def test_a_view_of_the_model_itself_ends_where_it_was_taken(gourd: Pair) -> None:
    start = gourd.off(0, 2.0, 0.01) @ np.linalg.inv(gourd.poses[1]) @ gourd.poses[0]
    fit = fit_onto(gourd.model, gourd.views[0], start, gourd.size)
    np.testing.assert_allclose(fit.T_model_view, gourd.poses[0], atol=2e-5 * gourd.size)
    assert fit.shared == 1


def test_a_plane_without_contours_leaves_its_slides_open() -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 60))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(3600)], axis=1)
    plane = Parts(points, np.tile([0.0, 0.0, 1.0], (3600, 1)), np.zeros((0, 3)), np.zeros((0, 3)))
    start = np.eye(4)
    start[:3, 3] = [0.03, 0.0, 0.02]
    fit = fit_onto(model_of(plane), plane, start, 2.0)
    # what nothing speaks of stays; what the plane says is followed
    np.testing.assert_allclose(fit.T_model_view[:3, 3], [0.03, 0.0, 0.0], atol=1e-6)
    deviation = np.sqrt(np.diag(fit.covariance))
    assert (deviation[[2, 3, 4]] > 0.04).all() and (deviation[[0, 1, 5]] < 1e-3).all()


def test_contours_are_what_keeps_flat_faces_from_sliding_and_the_fit_knows(block: Pair) -> None:
    bare = model_of(without_contours(block.model.parts))
    slid, held = [], []
    for seed in range(5):
        start = block.off(seed, 3.0, 0.02)
        loose = fit_onto(bare, without_contours(block.views[1]), start, block.size)
        firm = fit_onto(block.model, block.views[1], start, block.size)
        assert loose.deviations[1] > 0.045 * block.size
        assert block.error(firm.T_model_view)[1] * block.size < 3 * firm.deviations[1] < 0.015 * block.size
        slid.append(block.error(loose.T_model_view)[1])
        held.append(block.error(firm.T_model_view)[1])
    assert max(held) < 0.5 * max(slid)


def test_lengths_in_another_unit_change_nothing(block: Pair) -> None:
    def scaled(parts: Parts) -> Parts:
        return Parts(1024 * parts.points, parts.normals, 1024 * parts.contours, parts.tangents)

    start = block.off(0, 3.0, 0.02)
    metres = fit_onto(block.model, block.views[1], start, block.size)
    start = start.copy()
    start[:3, 3] *= 1024
    millimetres = fit_onto(model_of(scaled(block.model.parts)), scaled(block.views[1]), start, 1024 * block.size)
    np.testing.assert_allclose(millimetres.T_model_view[:3, :3], metres.T_model_view[:3, :3], atol=1e-9)
    np.testing.assert_allclose(millimetres.T_model_view[:3, 3], 1024 * metres.T_model_view[:3, 3], rtol=1e-6)
    assert millimetres.deviations == pytest.approx((metres.deviations[0], 1024 * metres.deviations[1]), rel=1e-6)


def test_a_view_far_from_the_model_is_said_to_share_too_little(gourd: Pair) -> None:
    start = gourd.off(0, 0.0, 2.0)
    fit = fit_onto(gourd.model, gourd.views[1], start, gourd.size)
    assert fit.outcome is FitOutcome.LITTLE_SHARED
    np.testing.assert_array_equal(fit.T_model_view, start)
    assert np.isinf(fit.deviations).all() and "too few" in fit.outcome.sentence


def test_a_model_grows_by_views(gourd: Pair) -> None:
    grown = gourd.model.with_view(gourd.views[1], gourd.poses[1])
    assert isinstance(grown, Model)
    assert len(grown.parts.points) == len(gourd.views[0].points) + len(gourd.views[1].points)
    fit = fit_onto(grown, gourd.views[1], gourd.off(1, 2.0, 0.01), gourd.size)
    assert fit.shared == 1 and gourd.error(fit.T_model_view)[0] < 0.01


def test_nothing_to_fit_is_refused() -> None:
    nothing = np.zeros((0, 3))
    with pytest.raises(InputError, match="at least one point"):
        model_of(Parts(nothing, nothing, nothing, nothing))
    with pytest.raises(InputError, match="is empty"):
        parts_of(RangeImage(np.full((4, 4, 3), np.nan, np.float32), np.zeros((4, 4), bool)))
