"""Laws of splitting: every reading in one triangle, bounds met at the end, smaller bounds and larger counts nested."""

import numpy as np
import pytest
from edge_maps import height_field
from split_scenes import roof_heights, scanned, terrace_heights, waves

from jaxmodel.control_points.conforming_delaunay import Pieces
from jaxmodel.control_points.image_surfaces import Surfaces, surfaces_of
from jaxmodel.control_points.pixel_triangulation import HORIZON, doubled_areas
from jaxmodel.control_points.triangle_splitting import (
    SplitOptions,
    Splitting,
    centres_of,
    reach_bound,
    reach_count,
    split_points,
    start,
)
from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage

NONE = Pieces.of(np.zeros((0, 2, 2), dtype=np.int64))
IMAGES = {
    "waves": waves(),
    "terrace": height_field(terrace_heights()),
    "roof": height_field(roof_heights()),
    "steps": scanned("block_steps", 100),
}


def bounded(image: RangeImage, bound: float, pieces: Pieces = NONE) -> tuple[Surfaces, Splitting]:
    surfaces, options = surfaces_of(image), SplitOptions(bound=bound)
    return surfaces, reach_bound(surfaces, start(surfaces, pieces, options), options)


def counted(image: RangeImage, count: int, pieces: Pieces = NONE) -> tuple[Surfaces, Splitting]:
    surfaces, options = surfaces_of(image), SplitOptions()
    return surfaces, reach_count(surfaces, start(surfaces, pieces, options), options, count, "vertices")


@pytest.mark.parametrize("name", IMAGES)
def test_before_the_filters_triangles_cover_the_plane_and_each_reading_is_in_one(name: str) -> None:
    surfaces, state = bounded(IMAGES[name], 0.5)
    h, w = surfaces.valid.shape
    areas = doubled_areas(state.places, state.mesh.triangles)
    assert areas.min() > 0 and areas.sum() == 2 * np.prod(np.ptp(state.places, axis=0))
    np.testing.assert_array_equal(np.sort(state.within.pixel), np.arange(h * w))
    assert surfaces.valid[state.mesh.pixels[:, 0], state.mesh.pixels[:, 1]].all()
    assert len(np.unique(state.mesh.pixels, axis=0)) == len(state.mesh.pixels)


@pytest.mark.parametrize("name", IMAGES)
@pytest.mark.parametrize("bound", [2.0, 0.3])
def test_at_the_end_every_triangle_with_a_reading_to_split_at_meets_its_bound(name: str, bound: float) -> None:
    surfaces, state = bounded(IMAGES[name], bound)
    options = SplitOptions(bound=bound)
    holds = np.bincount(state.within.triangle[state.free], minlength=len(state.size)) > 0
    allowed = bound * np.maximum(state.size, 1.0) ** options.size_exponent
    noise = surfaces.noise * np.sqrt(1 + 3 * np.sqrt(2 / np.maximum(state.fit.readings, 1)))
    assert (state.fit.error <= allowed * state.fit.spacing * (1 + 1e-9) + noise)[holds].all()
    assert (state.fit.misplaced <= options.outline + allowed / options.outline_weight + 1e-9)[holds].all()


@pytest.mark.parametrize("name", IMAGES)
def test_at_the_end_no_surface_is_lost_to_the_filters(name: str) -> None:
    surfaces, state = bounded(IMAGES[name], 0.2)
    options = SplitOptions(bound=0.2)
    lost = surfaces.valid.ravel()[state.within.pixel] & ~state.filtered.kept[state.within.triangle]
    depth = surfaces.depth.ravel()[state.within.pixel[lost & state.free]]
    assert depth.max(initial=0) <= options.outline + 0.2 / options.outline_weight


@pytest.mark.parametrize("name", IMAGES)
def test_a_smaller_bound_gives_more_vertices(name: str) -> None:
    sizes = [len(bounded(IMAGES[name], bound)[1].mesh.pixels) for bound in (4.0, 1.0, 0.25, 0.0625)]
    assert sizes == sorted(sizes)
    assert sizes[-1] > sizes[0]


@pytest.mark.parametrize("slope", [0.0, 0.7, 2.0])
def test_a_plane_takes_its_corners_alone(slope: float) -> None:
    _, x = np.indices((40, 60)).astype(float)
    _, state = bounded(height_field(slope * x), 1e-3)
    assert sorted(state.mesh.pixels.tolist()) == [[0, 0], [0, 59], [39, 0], [39, 59]]
    assert state.filtered.kept.sum() == 2


def test_a_roof_is_split_along_its_ridge_alone() -> None:
    _, state = bounded(height_field(roof_heights()), 0.05)
    near = np.abs(state.mesh.pixels[:, 1] - 40) <= 5
    assert near.mean() > 0.7  # of the image it is 0.14


def test_split_points_are_the_free_readings_nearest_to_the_centres() -> None:
    surfaces, state = bounded(waves(), 1.0)
    inner = np.flatnonzero(
        (np.bincount(state.within.triangle[state.free], minlength=len(state.size)) > 0)
        & (state.mesh.triangles.min(axis=1) >= HORIZON)
        & ~state.off_outline
    )
    new = split_points(surfaces, state, inner)
    assert len(new) == len(inner) > 20
    for i, pixel in zip(inner, new, strict=True):
        here = (state.within.triangle == i) & state.free
        places = np.stack(np.divmod(state.within.pixel[here], 60), axis=1)
        centre = state.places[state.mesh.triangles[i]].mean(axis=0) / 2
        distance = np.linalg.norm(places - centre, axis=1)
        assert np.linalg.norm(pixel - centre) == pytest.approx(distance.min(), abs=1e-12)
        assert pixel.tolist() in places.tolist()


@pytest.mark.parametrize("name", IMAGES)
@pytest.mark.parametrize("count", [60, 350, 1000])
def test_count_is_reached(name: str, count: int) -> None:
    _, state = counted(IMAGES[name], count)
    assert abs(len(state.kept_vertices()) - count) <= max(0.02 * count, 2)


def test_more_than_there_is_gives_every_reading_on_a_surface() -> None:
    image = waves()
    _, state = counted(image, 100_000)
    assert len(state.kept_vertices()) == image.valid.sum()


def test_a_plane_is_filled_evenly_where_nothing_else_asks_for_points() -> None:
    _, state = counted(height_field(np.zeros((60, 80))), 300)
    pixels = state.kept_vertices()
    quarters = np.bincount((pixels[:, 0] >= 30) * 2 + (pixels[:, 1] >= 40), minlength=4)
    assert quarters.min() > 0.15 * len(pixels)


def test_centres_are_distinct_readings_inside_the_mesh() -> None:
    surfaces, state = counted(waves(), 200)
    centres = centres_of(surfaces, state)
    assert surfaces.valid[centres[:, 0], centres[:, 1]].all()
    assert len(np.unique(centres, axis=0)) == len(centres) > 250


@pytest.mark.parametrize(
    "wrong",
    [
        {"bound": -1.0},
        {"bound": float("nan")},
        {"outline": -1.0},
        {"outline_weight": -0.1},
        {"density": 1.0},
        {"shape": 0.05},
        {"size_exponent": 3.0},
    ],
)
def test_options_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"split mesh: {next(iter(wrong))} is"):
        SplitOptions(**wrong)
