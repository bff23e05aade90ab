"""The experiment ``mesh_segments`` in its quick form: counts, a resumed run, redrawing, bad configurations refused."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars
import pytest
import yaml

from jaxmodel.io.meshes import load_mesh
from jaxmodel.io.results import RunDir
from jaxmodel.mesh.segmentation import segment
from jaxmodel.run.cli import execute
from jaxmodel.run.meshing.grown_border import grow_from_border, read_views
from jaxmodel.run.meshing.plane_count import different_planes
from jaxmodel.run.meshing.segments_study import draw, prepare, tables
from jaxmodel.run.registry import load_experiment
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, join

SMALL = {
    "experiment": "mesh_segments",
    "scenes": ["one_plane", "crossing_planes", "two_tables"],
    "pixels": 24,
    "methods": ["ball-pivoting"],
    "method_points": 1000,
    "grow": "none",
}


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mesh_segments")
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    assert execute(["run", str(folder / "small.yaml"), "--out", str(folder / "run")]) == 0
    return folder / "run"


def test_the_scenes_have_the_thesis_s_counts_and_no_layers(out: Path) -> None:
    rows = {row["scene"]: row for row in polars.read_parquet(out / "results.parquet").to_dicts()}
    assert [rows["one_plane"][key] for key in ("points", "before", "segments", "planes")] == [320, 504, 1, 1]
    assert [rows["crossing_planes"][key] for key in ("points", "before", "segments", "planes")] == [480, 756, 2, 2]
    assert [rows["two_tables"][key] for key in ("segments", "planes", "components")] == [2, 1, 2]
    for row in rows.values():
        assert row["lying_over"] == 0
    assert rows["one_plane"]["lying_over_before"] > 0
    assert not (out / "parts").exists()


def test_the_meshes_and_the_pictures_are_there(out: Path) -> None:
    rows = polars.read_parquet(out / "results.parquet")
    for name, triangles in rows.select("scene", "after").iter_rows():
        assert len(load_mesh(out / "meshes" / f"{name}.ply").faces) == triangles
        assert (out / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert "published | ours" in (out / "report.html").read_text()


def test_published_stands_beside_ours(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    shown = tables(summary, "the command")
    row = shown[-1].rows[0]
    assert row[1:3] == ("320 | 320", "504 | 504") and row[4] == "1 | 1"
    facts = {of[0]: of[1] for of in shown[-2].rows}
    assert facts["a ball: closed"].endswith("| closed")
    assert summary["methods"][0]["own_vertices"] == 1.0 and summary["methods"][0]["hollow"] > 0.95


def test_a_resumed_run_is_the_unbroken_one(out: Path, tmp_path: Path) -> None:
    from jaxmodel.run.console import Progress
    from jaxmodel.run.provenance import manifest

    _, config = load_experiment(SMALL, "small.yaml")
    broken = prepare(config)
    with RunDir.create(tmp_path / "run", manifest("mesh_segments", broken.resolved, {}, "a command")) as folder:
        name = "crossing_planes"
        folder.write_part("scene001", 0, polars.DataFrame([broken._row(folder, name, broken.scenes[name])]))
        broken.execute(folder, Progress())
    assert (tmp_path / "run" / "results.parquet").read_bytes() == (out / "results.parquet").read_bytes()


def test_it_is_drawn_again_from_the_folder(out: Path) -> None:
    (out / "figures" / "one_plane.png").unlink()
    with RunDir.resume(out) as folder:
        draw(folder, json.loads((out / "summary.json").read_text()))
    assert (out / "figures" / "one_plane.png").is_file()


def test_growth_keeps_most_of_the_first_view() -> None:
    grown = grow_from_border(read_views("boulder", 4))
    assert len(grown.rows) == 3 and len(grown.owner) == len(grown.mesh.faces)
    assert (grown.owner == 0).sum() > 0.85 * len(grown.first.faces)
    assert all(row["lying_over"] == 0 for row in grown.rows)
    assert all(row["kept_triangles"] > 0.9 * row["of_triangles"] for row in grown.rows)


def test_pieces_of_one_plane_count_once() -> None:
    def plate(x: float, z: float) -> ObjectMesh:
        mesh = box((0, 0, 0), (1, 1, 1), 4)
        top = mesh.faces[(mesh.vertices[mesh.faces][:, :, 2] == 1).all(axis=1)]
        used, faces = np.unique(top, return_inverse=True)
        return ObjectMesh(mesh.vertices[used] + np.array([x, 0, z]), faces.reshape(-1, 3))

    for height, planes in ((0.0, 1), (0.2, 2)):
        mesh = join(plate(0, 0), plate(2, height))
        assert different_planes(mesh, segment(mesh).primitives, 0.0) == planes


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("scenes", "[one_plan]", "one_plan"),
        ("scenes", "[]", "scenes"),
        ("offset", "-0.1", "offset"),
        ("tilt_deg", ".nan", "tilt_deg"),
        ("pixels", "2", "pixels"),
        ("methods", "[balls]", "balls"),
        ("method_points", "3", "method_points"),
        ("order", "0", "order"),
        ("grow", "cat", "grow"),
        ("every", "0", "every"),
        ("least_share", "1", "least_share"),
        ("seed", "-1", "seed"),
    ],
)
def test_bad_configurations_are_refused(refused: Callable[..., str], key: str, value: str, said: str) -> None:
    assert said in refused("run", "configs/experiments/mesh_segments.yaml", f"--{key}", value, "--out", "out")
