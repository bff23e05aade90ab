"""Views with their truth: posed scans must lie on each other."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.io.datasets import FilePair, MeshViews, ObjectViews, StanfordBunny, data_root, mesh_file
from jaxmodel.io.poses import save_transform
from jaxmodel.scan.noise import Stereo
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor


def posed(data, name: str) -> np.ndarray:
    image, T = data.scan(name), data.T_world_scan(name)
    return image.points[image.valid] @ T[:3, :3].T + T[:3, 3]


@pytest.mark.data
@pytest.mark.parametrize(
    ("source", "target", "median_mm", "share"),
    [("bun000", "bun045", 0.326, 0.89), ("bun090", "bun045", 0.433, 0.64), ("chin", "bun000", 1.60, 0.47)],
)
def test_posed_bunny_scans_lie_on_each_other(data_dir, source, target, median_mm, share):
    bunny = StanfordBunny(data_dir)
    distance_mm = 1e3 * KDTree(posed(bunny, target)).query(posed(bunny, source))[0]
    assert np.median(distance_mm) == pytest.approx(median_mm, rel=0.02)
    assert np.mean(distance_mm < 1.0) == pytest.approx(share, abs=0.01)


@pytest.mark.data
def test_the_relative_pose_is_the_posed_one(data_dir):
    bunny = StanfordBunny(data_dir)
    assert len(bunny.names) == 10 and bunny.has_truth
    T = bunny.T_target_source("bun045", "top3")
    np.testing.assert_allclose(bunny.T_world_scan("bun045") @ T, bunny.T_world_scan("top3"), atol=1e-9)
    assert StanfordBunny(data_dir / "stanford_bunny").names == bunny.names
    with pytest.raises(InputError, match="no bunny scan 'bun001'; there are bun000"):
        bunny.scan("bun001")


def test_an_absent_bunny_tells_what_to_set(tmp_path):
    with pytest.raises(InputError, match="set JAXMODEL_DATA to the folder that holds stanford_bunny"):
        StanfordBunny(tmp_path)


def test_the_data_folder_comes_from_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXMODEL_DATA", str(tmp_path))
    assert data_root() == tmp_path
    with pytest.raises(InputError, match="JAXMODEL_DATA"):
        StanfordBunny()
    monkeypatch.setenv("JAXMODEL_DATA", str(tmp_path / "gone"))
    with pytest.raises(InputError, match="gone', which is not a folder"):
        data_root()


def test_without_the_variable_the_neighbouring_folder_is_taken(tmp_path, monkeypatch):
    monkeypatch.delenv("JAXMODEL_DATA", raising=False)
    (tmp_path / "project").mkdir()
    (tmp_path / "shared" / "data").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "project")
    assert data_root() == tmp_path / "shared" / "data"


SMALL = Sensor(width=70, height=70)


def test_posed_views_of_an_object_lie_on_each_other():
    views = ObjectViews("boulder", (0.0, 30.0), SMALL)
    assert views.names == ("boulder000", "boulder030")
    target = views.scan("boulder000")
    T = views.T_target_source("boulder000", "boulder030")
    source = views.scan("boulder030")
    moved = source.points[source.valid] @ T[:3, :3].T + T[:3, 3]
    distance, _ = KDTree(target.points[target.valid]).query(moved)
    assert np.median(distance) < 0.015  # pixels are 0.02 apart
    np.testing.assert_allclose(views.T_world_scan("boulder000") @ T, views.T_world_scan("boulder030"), atol=1e-12)


def test_a_view_is_the_same_alone_and_among_others_of_the_same_place():
    model = Stereo()
    first = ObjectViews("gourd", (10.0, 50.0), SMALL, model, seed=5)
    again = ObjectViews("gourd", (10.0,), SMALL, model, seed=5)
    other = ObjectViews("gourd", (10.0,), SMALL, model, seed=6)
    np.testing.assert_array_equal(first.scan("gourd010").points, again.scan("gourd010").points)
    assert not np.array_equal(first.scan("gourd010").points, other.scan("gourd010").points, equal_nan=True)


def test_unknown_objects_and_views_are_refused():
    with pytest.raises(InputError, match="no built-in object 'teapot'"):
        ObjectViews("teapot")
    with pytest.raises(InputError, match="no view 'gourd001'; there are gourd000"):
        ObjectViews("gourd", (0.0,)).scan("gourd001")
    with pytest.raises(InputError, match="given twice"):
        ObjectViews("gourd", (0.0, 0.0))
    with pytest.raises(InputError, match="at least one angle"):
        ObjectViews("gourd", ())


def test_views_of_any_mesh_are_those_of_the_object_with_the_same_mesh():
    mine = MeshViews("mine", object_mesh("gourd"), (10.0, 50.0), SMALL, Stereo(), seed=5)
    known = ObjectViews("gourd", (10.0, 50.0), SMALL, Stereo(), seed=5)
    assert mine.names == ("mine010", "mine050") and mine.has_truth
    for view, other in zip(mine.names, known.names, strict=True):
        np.testing.assert_array_equal(mine.scan(view).points, known.scan(other).points)
    np.testing.assert_array_equal(mine.T_target_source(*mine.names), known.T_target_source(*known.names))


def test_a_mesh_file_is_a_path_or_a_name_in_the_data_folder(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    for name in ("nut.obj", "cow.ply", "notes.txt"):
        (tmp_path / "meshes" / name).write_text("")
    monkeypatch.setenv("JAXMODEL_DATA", str(tmp_path))
    assert mesh_file("nut") == tmp_path / "meshes" / "nut.obj"
    assert mesh_file(tmp_path / "meshes" / "cow.ply") == tmp_path / "meshes" / "cow.ply"
    with pytest.raises(InputError, match=r"no mesh file 'notes'.*there are cow, nut"):
        mesh_file("notes")
    monkeypatch.setenv("JAXMODEL_DATA", str(tmp_path / "meshes"))
    with pytest.raises(InputError, match="no meshes were found, set JAXMODEL_DATA"):
        mesh_file("nut")


def write_pair(folder):
    rng = np.random.default_rng(0)
    for name in ("left", "right"):
        np.savez(folder / f"{name}.npz", points=rng.normal(size=(4, 5, 3)))
    return folder / "left.npz", folder / "right.npz"


def test_a_pair_of_files_with_truth(tmp_path):
    left, right = write_pair(tmp_path)
    T = np.array([[0, -1, 0, 1.0], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    save_transform(tmp_path / "truth.json", T)
    pair = FilePair(left, right, tmp_path / "truth.json")
    assert pair.names == ("left", "right") and pair.has_truth
    assert isinstance(pair.scan("left"), RangeImage)
    np.testing.assert_array_equal(pair.T_target_source("left", "right"), T)
    np.testing.assert_allclose(pair.T_target_source("right", "left"), np.linalg.inv(T), atol=1e-12)


def test_a_pair_without_truth_says_so(tmp_path):
    pair = FilePair(*write_pair(tmp_path))
    assert not pair.has_truth
    with pytest.raises(InputError, match="No truth file was given for left and right"):
        pair.T_target_source("left", "right")
    with pytest.raises(InputError, match="no scan 'middle'; there are left, right"):
        pair.scan("middle")


def test_a_pair_must_be_two_files(tmp_path):
    left, _ = write_pair(tmp_path)
    with pytest.raises(InputError, match="same file"):
        FilePair(left, left)
    with pytest.raises(InputError, match=r"There is no file .*gone\.npz"):
        FilePair(left, tmp_path / "gone.npz")
    (tmp_path / "other").mkdir()
    left.rename(tmp_path / "other" / "right.npz")
    assert len(set(FilePair(tmp_path / "other" / "right.npz", tmp_path / "right.npz").names)) == 2
