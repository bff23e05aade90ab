"""From the ``scans`` node to pairs: names, truths, turns and meshes."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.io.strict_yaml import structure
from jaxmodel.run.config import MeshScans, ObjectScans
from jaxmodel.run.pairs import Pair, load_pairs, source_extent
from jaxmodel.scan.sensor import Sensor

SMALL = Sensor(width=60, height=60)
CUBE = "".join(f"v {x} {3 * y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1)) + (
    "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
)


def gap(pair: Pair) -> float:
    """Median distance of the source's points to the target, both posed by the truth."""
    assert pair.T_target_source is not None
    target, source = pair.target.points[pair.target.valid], pair.source.points[pair.source.valid]  # type: ignore[union-attr]
    moved = source @ pair.T_target_source[:3, :3].T + pair.T_target_source[:3, 3]
    return float(np.median(KDTree(target).query(moved)[0]))


def test_one_turn_keeps_the_objects_name() -> None:
    pairs = load_pairs(ObjectScans(("boulder", "valve"), sensor=SMALL, noise=None), 0)
    assert [pair.name for pair in pairs] == [pair.subject for pair in pairs] == ["boulder", "valve"]
    assert [pair.family for pair in pairs] == ["free_form", "structured"]


def test_turns_make_pairs_of_one_object_with_their_truth() -> None:
    turned = load_pairs(ObjectScans(("valve",), views_deg=(10.0, 40.0), turns_deg=(0.0, 30.0, 330.0), sensor=SMALL), 0)
    assert [pair.name for pair in turned] == ["valve010-040", "valve040-070", "valve340-010"]
    assert {pair.subject for pair in turned} == {"valve"}
    assert all(gap(pair) < 0.02 for pair in turned)  # pixels are 0.025 apart
    np.testing.assert_array_equal(turned[0].target.points, turned[2].source.points)  # one view, one scan


def test_views_draw_their_noise_apart_and_by_the_seed() -> None:
    scans = ObjectScans(("boulder",), sensor=SMALL)
    first, again, other = (load_pairs(scans, seed)[0] for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.source.points, again.source.points)
    assert not np.array_equal(first.source.points, other.source.points, equal_nan=True)


def test_a_mesh_is_brought_to_unit_size_with_its_axis_up(tmp_path: Path) -> None:
    path = tmp_path / "block.obj"
    path.write_text(CUBE)
    scans = MeshScans((str(path),), family="structured", up="y", sensor=SMALL, noise=None, turns_deg=(0.0, 90.0))
    pairs = load_pairs(scans, 0)
    assert [pair.name for pair in pairs] == ["block000-030", "block090-120"]
    assert all(pair.family == "structured" and pair.files == (path,) and gap(pair) < 0.02 for pair in pairs)
    heights = np.nanmax(pairs[0].target.points[..., 1]) - np.nanmin(pairs[0].target.points[..., 1])
    assert 0.9 < heights < 1.2  # the long side, 3 in the file, stands upright in the image


@pytest.mark.data
@pytest.mark.parametrize("name", ["fandisk", "wingnut", "spot", "suzanne"])
def test_the_meshes_of_the_data_folder_are_scanned(name: str, data_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAXMODEL_DATA", str(data_dir))
    (pair,) = load_pairs(MeshScans((name,), family="structured", sensor=SMALL), 0)
    assert pair.name == pair.subject == name and pair.target.points.shape == (60, 60, 3) and gap(pair) < 0.03


def test_equal_views_and_absent_meshes_are_refused(tmp_path: Path) -> None:
    for views in ((10.0, 10.0), (0.0, 360.0)):
        with pytest.raises(InputError, match="given twice"):
            load_pairs(ObjectScans(("boulder",), views_deg=views, sensor=SMALL), 0)
    with pytest.raises(InputError, match="no mesh file 'nothing'"):
        load_pairs(MeshScans(("nothing",), sensor=SMALL), 0)
    with pytest.raises(InputError, match="turns_deg is empty"):
        structure({"kind": "meshes", "names": ["spot"], "turns_deg": []}, MeshScans, "test")


def test_the_extent_is_that_of_the_sources_points() -> None:
    (pair,) = load_pairs(ObjectScans(("valve",), sensor=SMALL), 0)
    points = pair.source.points[pair.source.valid]  # type: ignore[union-attr]
    centroid, size = source_extent(pair)
    np.testing.assert_allclose(centroid, points.mean(axis=0), rtol=1e-12)
    assert size == pytest.approx(float(np.linalg.norm(points.max(axis=0) - points.min(axis=0))))
