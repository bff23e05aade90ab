"""Laws of contours: two chains for a depth edge, ends kept, barbs gone, loops closed; on made and scanned maps."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from edge_maps import all_pixels, digital_line, edge_map, height_field, scanned, steps_image
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from jaxmodel.control_points import find_contours
from jaxmodel.control_points.contours import ALL_KINDS, ContourOptions, ContourOutcome
from jaxmodel.control_points.edges import EdgeKind, find_edges
from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage

SHAPE = (60, 80)
FLAT = np.zeros(SHAPE)


def marked(pixels: np.ndarray, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    kind = np.zeros(shape, dtype=int)
    kind[tuple(pixels.T)] = EdgeKind.CREASE
    return kind


# Made maps


@pytest.mark.parametrize("end", [(30, 70), (52, 41), (25, 9), (55, 70), (30, 9), (58, 12)])
@pytest.mark.parametrize("thickness", [1, 2, 3, 4])
def test_a_line_of_any_thickness_is_one_chain_as_long_as_the_line(end: tuple[int, int], thickness: int) -> None:
    line = digital_line(SHAPE, (5, 10), end)
    offsets = np.arange(thickness) - thickness // 2
    thick = (line[:, None, None] + np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(1, -1, 1, 2)).reshape(-1, 2)
    thick = np.unique(np.clip(thick, 0, np.array(SHAPE) - 1), axis=0)
    contours = find_contours(height_field(FLAT), edge_map(marked(thick)))
    (chain,) = contours.chains
    assert not chain.closed
    assert KDTree(chain.pixels[[0, -1]]).query(line[[0, -1]])[0].max() <= 2.0
    assert KDTree(line).query(chain.pixels)[0].max() <= 2.0
    assert np.linalg.norm(np.diff(chain.pixels, axis=0), axis=1).max() <= np.sqrt(2)


@given(seed=st.integers(0, 10_000))
def test_barbs_go_and_the_ends_of_the_line_stay_within_two_pixels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    line = digital_line(SHAPE, (int(rng.integers(5, 50)), 5), (int(rng.integers(5, 50)), 74))
    pixels = [line]
    for at in rng.choice(np.arange(6, len(line) - 6), size=6, replace=False):
        length = int(rng.integers(1, 5))
        pixels.append(line[at] + rng.choice([-1, 1]) * np.stack([np.arange(1, length + 1), np.zeros(length, int)], 1))
    contours = find_contours(height_field(FLAT), edge_map(marked(np.concatenate(pixels))))
    found = all_pixels(contours)
    assert KDTree(line).query(found)[0].max() <= 2.0
    assert KDTree(found).query(line)[0].max() <= 2.0


@given(seed=st.integers(0, 10_000), missing=st.floats(0.0, 0.2))
@example(seed=47, missing=0.05)
@example(seed=73, missing=0.1)
@example(seed=102, missing=0.18)
@example(seed=201, missing=0.12)
def test_a_ragged_line_with_gaps_is_followed_over_its_whole_length(seed: int, missing: float) -> None:
    rng = np.random.default_rng(seed)
    line = digital_line(SHAPE, (int(rng.integers(10, 50)), 4), (int(rng.integers(10, 50)), 75))
    ragged = line + np.stack([rng.integers(-1, 2, len(line)), 0 * line[:, 1]], axis=1)
    ragged = ragged[rng.random(len(line)) > missing]
    gap_px = np.linalg.norm(np.diff(ragged, axis=0), axis=1).max()
    contours = find_contours(height_field(FLAT), edge_map(marked(ragged)), options=ContourOptions(gap_px=gap_px))
    found = all_pixels(contours)
    assert found[:, 1].min() - ragged[0, 1] <= 2 and ragged[-1, 1] - found[:, 1].max() <= 2
    assert KDTree(found).query(ragged)[0].max() <= 3.5


@pytest.mark.parametrize("radius", [4.0, 9.5, 22.0])
def test_a_closed_loop_is_one_closed_chain(radius: float) -> None:
    angle = np.linspace(0, 2 * np.pi, 2000)
    ring = np.unique(np.rint([30, 40] + radius * np.stack([np.sin(angle), np.cos(angle)], 1)).astype(int), axis=0)
    (chain,) = find_contours(height_field(FLAT), edge_map(marked(ring))).chains
    assert chain.closed
    around = np.concatenate([chain.pixels, chain.pixels[:1]])
    assert np.linalg.norm(np.diff(around, axis=0), axis=1).max() <= np.sqrt(2)
    assert KDTree(chain.pixels).query(ring)[0].max() <= 1.0


def test_lines_that_meet_are_chains_that_end_there() -> None:
    cross = np.concatenate([digital_line(SHAPE, (30, 5), (30, 75)), digital_line(SHAPE, (5, 40), (29, 40))])
    contours = find_contours(height_field(FLAT), edge_map(marked(cross)))
    long = [chain for chain in contours.chains if len(chain) > 5]
    assert len(long) == 3 and [len(chain) for chain in contours.chains] == sorted(map(len, contours.chains))[::-1]
    for chain in long:
        assert np.linalg.norm(chain.pixels[[0, -1]] - [30, 40], axis=1).min() <= 1.5


@pytest.mark.parametrize("turn_deg", [0.0, 18.0, 45.0, 71.0, 90.0])
@pytest.mark.parametrize("height", [0.8, 8.0, 500.0])
def test_a_depth_edge_gives_two_chains_one_on_each_side(turn_deg: float, height: float) -> None:
    row, column = np.indices(SHAPE)
    turn = np.deg2rad(turn_deg)
    across = (column - 40) * np.cos(turn) + (row - 30) * np.sin(turn)
    above = across > 0
    side = np.zeros(SHAPE, dtype=bool)
    for axis in (0, 1):
        step = np.diff(above, axis=axis)
        low, high = (slice(None, -1), slice(1, None)) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        side[low] |= step
        side[high] |= step
    image = height_field(np.where(above, height, 0.0))
    contours = find_contours(image, edge_map(side * int(EdgeKind.DEPTH), far=~above))
    assert len(contours.chains) == 2
    sides = [set(above[tuple(chain.pixels.T)]) for chain in contours.chains]
    assert sorted(map(tuple, sides)) == [(False,), (True,)]
    shorter = min(len(chain) for chain in contours.chains)
    assert shorter >= 0.9 * max(np.ptp(np.argwhere(side), axis=0))


def test_a_jump_that_fades_out_is_two_chains_all_the_same() -> None:
    kind = np.zeros(SHAPE, dtype=int)
    kind[30, 5:60] = kind[31, 5:60] = EdgeKind.DEPTH
    kind[29:33, 60] = EdgeKind.CREASE  # where the two sides are one surface again
    far = np.indices(SHAPE)[0] == 31
    image = height_field(np.where(np.indices(SHAPE)[0] > 30, -0.5, 0.0))
    contours = find_contours(image, edge_map(kind, far=far))
    long = [chain for chain in contours.chains if len(chain) > 20]
    assert len(long) == 2
    for chain in contours.chains:
        depth = chain.pixels[chain.kind == EdgeKind.DEPTH]
        assert len(set(depth[:, 0])) <= 1


def test_chains_carry_what_was_measured_and_how_it_is_labelled() -> None:
    image = steps_image()
    edges = find_edges(image)
    contours = find_contours(image, edges)
    assert contours.outcome is ContourOutcome.FOUND
    kinds = set()
    for chain in contours.chains:
        at = tuple(chain.pixels.T)
        np.testing.assert_array_equal(chain.points, image.points[at])
        np.testing.assert_array_equal(chain.kind, edges.kind[at])
        assert len(chain) >= 2 and chain.kind.min() > 0
        kinds |= set(chain.kind.tolist())
    assert kinds == {1, 2, 3}


@pytest.mark.parametrize("kinds", [(EdgeKind.CREASE,), (EdgeKind.BORDER, EdgeKind.DEPTH), ALL_KINDS])
def test_only_the_kinds_asked_for_are_followed(kinds: Sequence[EdgeKind]) -> None:
    contours = find_contours(steps_image(), find_edges(steps_image()), kinds)
    assert {int(kind) for chain in contours.chains for kind in chain.kind} == set(map(int, kinds))


# Scanned objects


@pytest.mark.parametrize("name", ["block_steps", "valve", "y_pipe"])
@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_no_chain_of_a_scanned_object_changes_the_side_of_a_jump(name: str, noise: float) -> None:
    image = scanned(name, noise=noise)
    edges = find_edges(image)
    contours = find_contours(image, edges)
    depth = edges.kind == EdgeKind.DEPTH
    sides = {False: 0, True: 0}
    for chain in contours.chains:
        at = tuple(chain.pixels.T)
        far = set(edges.far[at][depth[at]])
        assert len(far) <= 1
        for side in far:
            sides[bool(side)] += int(depth[at].sum())
    assert min(sides.values()) > 60
    assert min(sides.values()) > 0.6 * max(sides.values())


def test_without_noise_contours_lose_no_edge_that_is_longer_than_a_barb() -> None:
    image = scanned("block_steps")
    edges = find_edges(image)
    found = all_pixels(find_contours(image, edges))
    away = KDTree(found).query(np.argwhere(edges.kind > 0))[0]
    assert np.mean(away <= 2.0) > 0.97


def test_unit_does_not_matter() -> None:
    image, edges = steps_image(), find_edges(steps_image())
    for factor in (1024.0, 1e-3):
        scaled = RangeImage(points=factor * image.points, valid=image.valid, eye=image.eye)
        one, other = find_contours(image, edges), find_contours(scaled, edges)
        assert len(one.chains) == len(other.chains)
        for a, b in zip(one.chains, other.chains, strict=True):
            np.testing.assert_array_equal(a.pixels, b.pixels)
            assert a.closed == b.closed


def test_turned_images_have_the_same_contours() -> None:
    image, edges = steps_image(), find_edges(steps_image())
    found = all_pixels(find_contours(image, edges))
    w = image.valid.shape[1]

    def turned(array: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(np.rot90(array))

    quarter = edge_map(turned(edges.kind), turned(edges.far), turned(edges.valid))
    other = find_contours(RangeImage(turned(image.points), turned(image.valid), image.eye), quarter)
    back = all_pixels(other)
    back = np.stack([back[:, 1], w - 1 - back[:, 0]], axis=1)
    assert KDTree(found).query(back)[0].max() <= 2.0 and KDTree(back).query(found)[0].max() <= 2.0


# Bad input


def test_a_smooth_surface_has_no_contour_and_says_so() -> None:
    row, column = np.indices(SHAPE)
    image = height_field(-0.01 * ((row - 30.0) ** 2 + (column - 40.0) ** 2))
    contours = find_contours(image, find_edges(image), (EdgeKind.CREASE, EdgeKind.DEPTH))
    assert contours.chains == () and contours.outcome is ContourOutcome.NO_EDGE
    assert "single smooth surface" in contours.outcome.sentence
    (outline,) = find_contours(image, find_edges(image)).chains
    assert outline.closed and set(outline.kind) == {EdgeKind.BORDER}


def test_an_image_without_a_valid_pixel() -> None:
    image = height_field(np.full(SHAPE, np.nan))
    contours = find_contours(image, find_edges(image))
    assert contours.chains == () and contours.outcome is ContourOutcome.NO_READING


@pytest.mark.parametrize("shape", [(1, 60), (60, 1), (1, 1), (2, 2)])
def test_an_image_with_one_row_or_column(shape: tuple[int, int]) -> None:
    z = np.where(np.arange(shape[0] * shape[1]).reshape(shape) > 30, 9.0, 0.0)
    contours = find_contours(height_field(z), find_edges(height_field(z)))
    assert contours.outcome in (ContourOutcome.FOUND, ContourOutcome.TOO_SMALL)
    for chain in contours.chains:
        assert len(set(z[tuple(chain.pixels.T)])) == 1


def test_groups_that_are_too_small_are_left_out_and_said_so() -> None:
    kind = np.zeros(SHAPE, dtype=int)
    kind[10, 5:16] = kind[20, 5:10] = EdgeKind.CREASE
    contours = find_contours(height_field(FLAT), edge_map(kind))
    assert contours.chains == () and contours.outcome is ContourOutcome.TOO_SMALL
    kind[10, 16] = EdgeKind.CREASE
    assert [len(chain) for chain in find_contours(height_field(FLAT), edge_map(kind)).chains] == [12]


def test_a_map_of_another_size_and_no_kind_are_refused() -> None:
    with pytest.raises(InputError, match=r"shape \(60, 79\), expected the image's \(60, 80\)"):
        find_contours(height_field(FLAT), edge_map(np.zeros((60, 79))))
    for kinds in ((), (EdgeKind.NONE,)):
        with pytest.raises(InputError, match="no kind of edge"):
            find_contours(height_field(FLAT), edge_map(FLAT), kinds)


@pytest.mark.parametrize(
    ("option", "value"), [("gap_px", 0.5), ("gap_px", np.nan), ("jump", 0.0), ("barb", -1), ("least", 1)]
)
def test_options_that_make_no_sense_are_refused(option: str, value: Any) -> None:
    with pytest.raises(InputError, match=f"contours: {option} is"):
        ContourOptions(**{option: value})


@pytest.mark.data
@pytest.mark.parametrize("name", ["bun000", "top3"])
def test_real_scan(data_dir: Path, name: str) -> None:
    from jaxmodel.io.scans import load_scan

    image = load_scan(data_dir / "stanford_bunny" / "data" / f"{name}.ply")
    assert isinstance(image, RangeImage)
    edges = find_edges(image)
    contours = find_contours(image, edges)
    for chain in contours.chains:
        at = tuple(chain.pixels.T)
        assert np.isfinite(chain.points).all()
        assert len(set(edges.far[at][edges.kind[at] == EdgeKind.DEPTH])) <= 1


@pytest.mark.data
@pytest.mark.parametrize("name", ["bun000", "top3"])
def test_a_real_scan_has_crease_contours(data_dir: Path, name: str) -> None:
    from jaxmodel.io.scans import load_scan

    image = load_scan(data_dir / "stanford_bunny" / "data" / f"{name}.ply")
    assert isinstance(image, RangeImage)
    assert len(all_pixels(find_contours(image, find_edges(image), (EdgeKind.CREASE,)))) > 100
