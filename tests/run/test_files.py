"""``sweep`` and ``register`` on own files: a scan and the same scan moved, so the answer is known exactly."""

import json
from pathlib import Path

import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.register.basin import truth_errors
from jaxmodel.run.cli import execute
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import scan_mesh, turntable_poses

pytestmark = pytest.mark.xdist_group("files")
METHOD = ("--method", "point_to_point", "--count", "5000")  # all points, so both scans hold the same ones


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``a.npz``, ``b.xyz``, the true motion in ``truth.txt`` and one 15 degrees off in ``guess.json``."""
    folder = tmp_path_factory.mktemp("scans")
    vertices = np.asarray(object_mesh("boulder").vertices, dtype=np.float64)
    target = np.random.default_rng(0).permutation(vertices[vertices[:, 2] > 0])[:400]
    T_target_source = np.eye(4)
    T_target_source[:3, :3] = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    T_target_source[:3, 3] = [0.3, -2.0, 1.0]
    source = (target - T_target_source[:3, 3]) @ T_target_source[:3, :3]
    np.savez(folder / "a.npz", points=target)
    np.savetxt(folder / "b.xyz", source)
    np.savetxt(folder / "truth.txt", T_target_source)
    off = np.eye(4)
    off[:3, :3] = Rotation.from_rotvec(np.radians([9.0, 9.0, -8.0])).as_matrix()
    centre = target.mean(axis=0)
    off[:3, 3] = centre - off[:3, :3] @ centre
    (folder / "guess.json").write_text(json.dumps({"T_target_source": (off @ T_target_source).tolist()}))
    return folder


def command(folder: Path, *words: str) -> list[str]:
    return [words[0], str(folder / "a.npz"), str(folder / "b.xyz"), *words[1:], *METHOD, "--json"]


def answer(capsys: pytest.CaptureFixture[str]) -> dict:
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_register_from_a_guess_finds_the_exact_motion(
    scans: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert execute(command(scans, "register", "--init", str(scans / "guess.json"), "--out", str(out))) == 0
    content = json.loads((out / "transform.json").read_text())
    assert answer(capsys) == {"status": "ok", "out": str(out), **content}
    truth, source = np.loadtxt(scans / "truth.txt"), np.loadtxt(scans / "b.xyz")
    errors = truth_errors(np.array([content["T_target_source"]]), truth, source.mean(axis=0))
    assert errors.rotation_deg[0] < 0.1 and errors.translation[0] < 1e-3
    assert content["overlap"] == 1.0 and content["matched_fraction"] == 1.0
    assert (
        content["confidence"] is None and content["plateau"] is None and content["starts"] == 1 and content["sentence"]
    )


def test_sweep_of_files_finds_the_motion_among_its_starts_whatever_the_chunk(
    scans: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ("sweep", "--starts", "60", "--grid", "even", "--truth", str(scans / "truth.txt"), "--out", str(out))
    assert execute(command(scans, *words, "--chunk", str(10**15))) == 0
    shown = answer(capsys)
    (case,) = shown["summary"]["cases"]
    table = polars.read_parquet(out / "results.parquet")
    assert shown["status"] == "ok" and len(table) == case["starts"] == case["success"]["total"] == 60
    assert case["best"]["right"] and case["best"]["rotation_error_deg"] < 0.1
    assert case["success"]["count"] == table["right"].sum() >= 1
    wrong = table.filter(~polars.col("right"))
    assert wrong["error"].min() > 5 * case["best"]["error"]
    assert case["plateau"]["found"] and case["plateau"]["precision"] == 1.0


@pytest.mark.parametrize(
    ("kind", "labels"),
    [("contours", ("crease",)), ("contours", ("crease", "depth", "border")), ("split_vertices", None)],
)
def test_register_by_contours_and_split_vertices_of_range_images(
    kind: str, labels: tuple[str, ...] | None, tmp_path: Path
) -> None:
    mesh, (T_world_sensor,) = object_mesh("block_steps"), turntable_poses([30.0], 3.0, 25.0)
    image = scan_mesh(mesh.vertices, mesh.faces, Sensor(width=150, height=150), T_world_sensor)
    np.savez(tmp_path / "scan.npz", points=image.points)
    off = np.eye(4)
    off[:3, :3] = Rotation.from_rotvec(np.radians([2.0, -1.0, 2.0])).as_matrix()
    centre = image.points[image.valid].mean(axis=0)
    off[:3, 3] = centre - off[:3, :3] @ centre
    np.savetxt(tmp_path / "guess.txt", off)
    scan, out = str(tmp_path / "scan.npz"), tmp_path / "out"
    chosen = ("--control-points", kind, "--count", "150") + (("--labels", *labels) if labels else ())
    words = ["register", scan, scan, *chosen, "--init", str(tmp_path / "guess.txt"), "--out", str(out)]
    assert execute(words) == 0
    found = np.array(json.loads((out / "transform.json").read_text())["T_target_source"])
    errors = truth_errors(found[None], np.eye(4), centre)
    assert errors.rotation_deg[0] < 0.05 and errors.translation[0] < 1e-3
    (node,) = json.loads((out / "manifest.json").read_text())["config"]["control_points"]
    assert node["kind"] == kind and node["count"] == 150 and node.get("labels") == (list(labels) if labels else None)
