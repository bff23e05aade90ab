"""``jaxmodel mesh``: its files say what the mesh is; bad input is one sentence, with nothing left behind."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.mesh_writing import mesh_bytes
from jaxmodel.io.meshes import load_mesh
from jaxmodel.io.strict_yaml import config_files
from jaxmodel.mesh.quality import quality
from jaxmodel.run.cli import execute
from jaxmodel.run.meshing import places
from jaxmodel.run.meshing.clouds import read_clouds
from jaxmodel.scan.triangle_mesh import icosphere

EXAMPLE = config_files() / "meshing" / "example.xyz"
ONCE = pytest.mark.xdist_group("mesh_command")
"""Tests of one mesh and of compiled kernels: one worker makes them."""
pytestmark = ONCE


def sphere(count: int = 500) -> np.ndarray:
    """Evenly spread points of the unit sphere (Fibonacci's lattice), which are their own normals."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


def write_cloud(path: Path, points: np.ndarray, normals: np.ndarray | None = None) -> str:
    """The points, with their normals if there are any, as text or ASCII PLY; the path as a word."""
    columns = points if normals is None else np.concatenate([points, normals], axis=1)
    rows = [" ".join(repr(float(value)) for value in row) for row in columns]
    names = ["x", "y", "z", "nx", "ny", "nz"][: columns.shape[1]]
    properties = [f"property double {name}" for name in names]
    header = ["ply", "format ascii 1.0", f"element vertex {len(rows)}", *properties, "end_header"]
    path.write_text("\n".join([*(header if path.suffix == ".ply" else []), *rows]) + "\n")
    return str(path)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one mesh with everything beside it: ball.ply of a sphere's points, measured against a finer one."""
    folder = tmp_path_factory.mktemp("mesh")
    cloud = write_cloud(folder / "sphere.xyz", sphere(), sphere())
    reference = icosphere(5)
    (folder / "true.ply").write_bytes(mesh_bytes(reference, ".ply", reference.vertices))
    words = ["--segment", "--report", "--reference", str(folder / "true.ply"), "--out", str(folder / "ball.ply")]
    assert execute(["mesh", cloud, *words]) == 0
    return folder


def tree(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())


def test_the_mesh_is_closed_and_its_vertices_are_the_measured_points(made: Path) -> None:
    mesh = load_mesh(made / "ball.ply")
    measures = quality(mesh)
    assert measures.closed and measures.euler == 2 and measures.components == 1
    assert {tuple(row) for row in mesh.vertices.tolist()} <= {tuple(row) for row in sphere().tolist()}
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()


def test_the_quality_file_tells_of_the_mesh_that_was_written(made: Path) -> None:
    told, measures = tree(made / "ball.quality.json"), quality(load_mesh(made / "ball.ply"))
    for name in ("vertices", "triangles", "components", "border_edges", "crowded_edges", "turned_pairs", "euler"):
        assert told["quality"][name] == getattr(measures, name)
    for name in ("area", "Q_equ", "Q_nor", "largest_share"):
        assert told["quality"][name] == pytest.approx(getattr(measures, name), rel=1e-12)
    assert sum(told["quality"]["Q_equ_histogram"]["counts"]) == measures.triangles
    assert told["method"] == "ball-pivoting" and told["outcome"].startswith("a closed surface")
    assert told["options"] == {"radii": "auto", "thinning": "auto", "closing": True, "smallest_part": 0.0}
    assert told["points"]["read"] == 500 and told["points"]["vertices"] == measures.vertices
    assert told["points"]["unused"] == 500 - measures.vertices and told["points"]["bad_normals"] == 0
    found = sum(one["triangles"] for one in told["passes"]) + told["points"]["closing_triangles"]
    found -= told["points"]["dropped_triangles"]
    assert found == measures.triangles
    assert set(told["inputs"]) == {str(made / "sphere.xyz"), str(made / "true.ply")}
    assert all(len(digest) == 64 for digest in told["inputs"].values()) and "numpy" in told["versions"]


def test_the_distance_to_the_reference_is_that_of_chords_to_their_sphere(made: Path) -> None:
    told, mesh = tree(made / "ball.quality.json")["reference"], load_mesh(made / "ball.ply")
    sides = mesh.vertices[mesh.faces] - mesh.vertices[mesh.faces[:, [1, 2, 0]]]
    radius = np.prod(np.linalg.norm(sides, axis=2), axis=1) / (
        2 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    )
    deepest = 1 - np.sqrt(1 - radius.max() ** 2)
    assert 0 < told["there"]["mean"] < told["hausdorff"] < deepest + 1e-3  # 1e-3: the reference's own facets


def test_the_segments_file_names_the_sphere(made: Path) -> None:
    told, mesh = tree(made / "ball.segments.json"), load_mesh(made / "ball.ply")
    assert len(told["labels"]) == len(mesh.faces) and set(told["labels"]) == set(range(len(told["primitives"])))
    assert [one["kind"] for one in told["primitives"]] == ["sphere"]
    (one,) = told["primitives"]
    assert one["radius"] == pytest.approx(1, abs=1e-6) and np.abs(one["point"]).max() < 1e-6
    assert one["triangles"] == len(mesh.faces) and one["area"] == pytest.approx(quality(mesh).area)


def test_the_report_holds_the_mesh_and_needs_no_network(made: Path) -> None:
    page = (made / "ball.report.html").read_text()
    assert '"type":"mesh3d"' in page and "Q_nor" in page and "a closed surface" in page
    outside = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"https?:|src\s*=|@import|url\(", outside)


def test_an_existing_mesh_is_kept_unless_told(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("sphere.xyz", "ball.ply", "ball.segments.json", "ball.quality.json"):
        (tmp_path / name).write_bytes((made / name).read_bytes())
    words = ["mesh", str(tmp_path / "sphere.xyz"), "--out", str(tmp_path / "ball.ply")]
    assert execute(words) == 2 and "already exists" in capsys.readouterr().err
    assert (tmp_path / "ball.ply").read_bytes() == (made / "ball.ply").read_bytes()
    assert execute([*words, "--overwrite", "--json"]) == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["status"] == "ok" and last["quality"]["euler"] == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.ply", "ball.quality.json", "sphere.xyz"]


def test_a_failure_while_writing_leaves_the_earlier_files(tmp_path: Path) -> None:
    old, impossible = tmp_path / "a.json", tmp_path / "no such folder" / "b.ply"
    old.write_bytes(b"old")
    with pytest.raises(InputError, match="cannot be written"):
        places.write_all({old: b"new", impossible: b"mesh"}, [])
    assert old.read_bytes() == b"old" and [path.name for path in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize(
    "words",
    [
        ["--method", "deformable", "--order", "3", "--start", "inside"],
        ["--method", "marching-cubes", "--smallest-part", "0.5"],
        ["--method", "poisson", "--depth", "4"],
        ["--radii", "0.2,0.4", "--thinning", "none", "--no-closing"],
    ],
    ids=lambda words: words[1],
)
def test_each_method_writes_a_mesh_near_the_sphere(made: Path, tmp_path: Path, words: list[str]) -> None:
    for suffix in ("obj", "stl")[: 1 if words[1] != "poisson" else 2]:
        out = tmp_path / f"mesh.{suffix}"
        assert execute(["mesh", str(made / "sphere.xyz"), *words, "--overwrite", "--out", str(out)]) == 0
        radius = np.linalg.norm(load_mesh(out).vertices, axis=1)
        spacing = np.sqrt(4 * np.pi / 500)
        assert np.abs(radius - 1).max() < spacing
    told = tree(tmp_path / "mesh.quality.json")
    options = dict(zip((word[2:].replace("-", "_") for word in words[::2]), words[1::2], strict=False))
    for name in set(options) & set(told["options"]) - {"radii", "thinning"}:
        assert str(told["options"][name]) == options[name]
    if "--radii" in words:
        assert told["options"]["radii"] == [0.2, 0.4] and told["options"]["closing"] is False
        assert [one["radius"] for one in told["passes"]] == [0.2, 0.4][: len(told["passes"])]


def test_no_normals_are_estimated(tmp_path: Path) -> None:
    cloud = write_cloud(tmp_path / "bare.ply", sphere(300))
    assert execute(["mesh", cloud, "--out", str(tmp_path / "m.ply")]) == 0
    told = tree(tmp_path / "m.quality.json")
    assert told["points"]["estimated_normals"] and not told["points"]["given_normals"]
    assert told["quality"]["euler"] == 2 and told["quality"]["closed"]


def test_posed_range_images_come_together_with_their_sensors(tmp_path: Path) -> None:
    u, v = np.meshgrid(np.linspace(-0.3, 0.3, 9), np.linspace(-0.3, 0.3, 7))
    grid = np.stack([u, v, np.sqrt(1 - u**2 - v**2)], axis=-1)
    pose = np.array([[0, 0, 1, 0.5], [1, 0, 0, -2], [0, 1, 0, 3], [0, 0, 0, 1]], dtype=float)
    eye = np.array([0, 0, 5, 1.0])
    for name in ("a", "b"):
        np.savez(tmp_path / f"{name}.npz", points=grid, eye=eye)
    (tmp_path / "poses.json").write_text(json.dumps({"a": np.eye(4).tolist(), "b.npz": pose.tolist()}))
    together = read_clouds([tmp_path / "a.npz", tmp_path / "b.npz"], tmp_path / "poses.json")
    flat = grid.reshape(-1, 3)
    np.testing.assert_allclose(together.points, np.concatenate([flat, flat @ pose[:3, :3].T + pose[:3, 3]]), atol=1e-12)
    assert together.eyes is not None and together.normals is not None
    np.testing.assert_allclose(together.eyes[[0, -1]], [eye, pose @ eye])
    toward = together.eyes[:, :3] - together.points
    assert (np.einsum("ij,ij->i", together.normals, toward) > 0).all()
    assert len(together.files) == 3 and together.notes == ()


def test_a_conf_names_its_scans(tmp_path: Path) -> None:
    write_cloud(tmp_path / "one.ply", sphere(50))
    write_cloud(tmp_path / "two.ply", sphere(60), sphere(60))
    lines = "camera 0 0 0 0 0 0 1\nbmesh one.ply 0 0 0 0 0 0 1\nbmesh two.ply 1 2 3 0 0 0 1\n"
    (tmp_path / "both.conf").write_text(lines)
    together = read_clouds([], tmp_path / "both.conf")
    np.testing.assert_allclose(together.points[50:], sphere(60) + np.array([1.0, 2.0, 3.0]))
    assert together.normals is None and together.eyes is None
    assert together.notes == ("1 of 2 files have no normals: all were estimated anew",)


def test_the_shipped_example_is_small_and_has_unit_normals() -> None:
    assert EXAMPLE.stat().st_size < 200_000
    cloud = read_clouds([EXAMPLE], None)
    assert cloud.normals is not None and len(cloud.points) > 1000


Refused = Callable[..., str]


@pytest.mark.parametrize(
    ("points", "normals", "words"),
    [
        (sphere(100), np.zeros((100, 3)), "100 of 100 normals are zero or not finite: expected a unit normal"),
        (np.outer(np.arange(50.0), [1, 2, 3]), None, "All 50 points lie on one line"),
        (np.ones((40, 3)), None, "all 40 points are equal"),
        (np.where(np.arange(100)[:, None] == 7, np.nan, sphere(100)), None, "point 7 (counted from 0)"),
        (np.zeros((0, 3)), None, "is empty"),
        (sphere(2), None, "has only 2 points"),
    ],
    ids=["zero normals", "line", "duplicates", "nan", "empty", "two points"],
)
def test_clouds_without_a_surface(
    refused: Refused, tmp_path: Path, points: np.ndarray, normals: np.ndarray | None, words: str
) -> None:
    sentence = refused("mesh", write_cloud(tmp_path / "bad.ply", points, normals), "--out", "m.ply")
    assert "bad.ply" in sentence and words in sentence


def test_a_radius_that_finds_no_seed_names_one_that_does(refused: Refused, tmp_path: Path) -> None:
    cloud = write_cloud(tmp_path / "sphere.xyz", sphere(), sphere())
    sentence = refused("mesh", cloud, "--radii", "0.001", "--out", "m.ply")
    assert "sphere.xyz: No ball of radius 0.001 rests on three points" in sentence and "would do" in sentence
    radius = sentence.rsplit("radius of ", 1)[1].split()[0]
    assert execute(["mesh", cloud, "--radii", radius, "--out", str(tmp_path / "m.ply")]) == 0


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["--radii", "90"], "A ball of radius 90 is too large"),
        (["--radii", "0.1,x"], "--radii 0.1,x: expected auto, or positive radii"),
        (["--radii", "-1"], "positive radii"),
        (["--thinning", "much"], "--thinning much: expected auto, none or a positive distance"),
        (["--smallest-part", "2"], "--smallest-part is 2, expected a share"),
        (["--method", "posson"], "--method posson: no such method, did you mean 'poisson'?"),
        (["--method", "poisson", "--radii", "1"], "--radii belongs to --method ball-pivoting, not to poisson"),
        (["--method", "poisson", "--no-closing"], "--no-closing belongs to --method ball-pivoting, not to poisson"),
        (["--method", "deformable", "--smallest-part", "0.1"], "--smallest-part belongs to --method ball-pivoting or"),
        (["--cell", "1"], "--cell belongs to --method marching-cubes, not to ball-pivoting"),
        (["--method", "marching-cubes", "--cell", "-1"], "--cell is -1, expected a positive length"),
        (["--method", "poisson", "--depth", "30"], "depth is 30, expected 2 to 12"),
        (["--method", "deformable", "--order", "0"], "order is 0, expected 1 or more"),
        (["--no-snap"], "--no-snap needs --segment"),
        (["--reference", "none.ply"], "There is no file none.ply"),
        (["--poses", "none.conf"], "none.conf"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_options_that_do_not_fit(refused: Refused, tmp_path: Path, words: list[str], fault: str) -> None:
    cloud = write_cloud(tmp_path / "sphere.xyz", sphere(200), sphere(200))
    assert fault in refused("mesh", cloud, *words, "--out", "m.ply")


def test_places_that_cannot_be_written(refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = write_cloud(tmp_path / "sphere.ply", sphere(200))
    assert "--out is required" in refused("mesh", cloud)
    assert "--out m.glb: expected a file ending in one of .ply, .obj, .stl" in refused("mesh", cloud, "--out", "m.glb")
    assert "found 'no ending'" in refused("mesh", cloud, "--out", "m")
    assert "there is no folder" in refused("mesh", cloud, "--out", "absent/m.ply")
    assert "is one of the inputs" in refused("mesh", cloud, "--out", "sphere.ply", "--overwrite")
    (tmp_path / "taken.ply").mkdir()
    assert "is a folder" in refused("mesh", cloud, "--out", "taken.ply", "--overwrite")
    monkeypatch.setattr(places.os, "access", lambda *_: False)
    assert "is not writable" in refused("mesh", cloud, "--out", "m.ply")


def test_clouds_that_cannot_be_read(refused: Refused, tmp_path: Path) -> None:
    cloud = write_cloud(tmp_path / "sphere.ply", sphere(100))
    (tmp_path / "broken.ply").write_bytes((tmp_path / "sphere.ply").read_bytes()[:900])
    (tmp_path / "words.xyz").write_text("these are no numbers\n")
    assert "There is no file absent.ply" in refused("mesh", "absent.ply", "--out", "m.ply")
    assert "broken.ply is truncated" in refused("mesh", "broken.ply", "--out", "m.ply")
    assert "words.xyz, line 1" in refused("mesh", "words.xyz", "--out", "m.ply")
    assert "unknown extension" in refused("mesh", "sphere.gif", "--out", "m.ply")
    assert "2 clouds need --poses FILE" in refused("mesh", cloud, "broken.ply", "--out", "m.ply")
    assert "No cloud is given" in refused("mesh", "--out", "m.ply")
    (tmp_path / "poses.json").write_text(json.dumps({"other": np.eye(4).tolist()}))
    assert "no pose for the scan 'sphere.ply'" in refused("mesh", cloud, "--poses", "poses.json", "--out", "m.ply")
    assert "only a .conf says where" in refused("mesh", "--poses", "poses.json", "--out", "m.ply")
