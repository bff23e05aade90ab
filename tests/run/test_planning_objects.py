"""The ten objects to plan views for: centred, of size one, closed where they say so."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from jaxmodel.errors import InputError
from jaxmodel.run.planning.objects import (
    BUILT_IN,
    FROM_FILES,
    PLANNING_OBJECTS,
    PlanningObject,
    is_watertight,
    planning_object,
)
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere, join


def check(thing: PlanningObject) -> None:
    used = thing.mesh.vertices[np.unique(thing.mesh.faces)]
    np.testing.assert_allclose(used.min(axis=0) + used.max(axis=0), 0, atol=1e-12)
    assert np.ptp(used, axis=0).max() == pytest.approx(1.0)
    oracle = trimesh.Trimesh(thing.mesh.vertices, thing.mesh.faces, process=False)
    assert oracle.is_watertight == thing.watertight
    if thing.watertight:
        assert oracle.volume > 0.01


def test_there_are_ten() -> None:
    assert len(PLANNING_OBJECTS) == len(set(PLANNING_OBJECTS)) == 10


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_objects_are_closed_centred_and_of_size_one(name: str) -> None:
    thing = planning_object(name)
    assert thing.name == name and thing.watertight
    check(thing)


@pytest.mark.data
@pytest.mark.parametrize("name", FROM_FILES)
def test_objects_from_files_are_centred_and_of_size_one(name: str, data_dir: Path, monkeypatch) -> None:
    monkeypatch.setenv("JAXMODEL_DATA", str(data_dir))
    thing = planning_object(name)
    assert thing.watertight == (name in ("spot", "fandisk", "wingnut"))  # as the data's own list says
    check(thing)


@pytest.mark.data
def test_the_bunny_stands_upright(data_dir: Path, monkeypatch) -> None:
    """The holes of the mesh are all in its lowest quarter, under the base and the chest."""
    monkeypatch.setenv("JAXMODEL_DATA", str(data_dir))
    mesh = planning_object("bunny").mesh
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    border = mesh.vertices[edges[count == 1]]
    assert len(border) > 50 and border[..., 2].max() < -0.25


def test_a_missing_file_is_named(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("JAXMODEL_DATA", str(tmp_path))
    for name, file in (("bunny", "bun_zipper_res2.ply"), ("spot", "meshes/spot.obj")):
        with pytest.raises(InputError, match=f"{name}.*{file}"):
            planning_object(name)


def test_without_a_data_folder_the_variable_is_named(monkeypatch) -> None:
    monkeypatch.setattr("jaxmodel.run.planning.objects.data_root", lambda: None)
    with pytest.raises(InputError, match="JAXMODEL_DATA"):
        planning_object("fandisk")
    assert planning_object("valve").watertight


def test_an_unknown_name_is_refused_with_those_there_are() -> None:
    with pytest.raises(InputError, match=r"teapot.*wingnut"):
        planning_object("teapot")


def test_watertight_is_a_matter_of_the_triangles_not_of_the_vertex_list() -> None:
    sphere = icosphere(2)
    assert is_watertight(sphere)
    assert is_watertight(ObjectMesh(sphere.vertices[sphere.faces].reshape(-1, 3), np.arange(960).reshape(-1, 3)))
    assert is_watertight(join(sphere, box((3, 3, 3), (4, 4, 4))))
    assert is_watertight(ObjectMesh(sphere.vertices, np.concatenate([sphere.faces, [(0, 0, 1)]])))
    assert not is_watertight(ObjectMesh(sphere.vertices, sphere.faces[1:]))
    assert not is_watertight(ObjectMesh(sphere.vertices, sphere.faces[:0]))
    turned = sphere.faces.copy()
    turned[5] = turned[5, ::-1]
    assert not is_watertight(ObjectMesh(sphere.vertices, turned))
