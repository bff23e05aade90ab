"""``jaxmodel align`` and the experiment ``multiview``: one command from scans to one frame, and what it refuses."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.geometry.se3 import inverse, rotation_angle_deg
from jaxmodel.io.datasets import ObjectViews, StanfordBunny
from jaxmodel.io.scans import load_scan
from jaxmodel.run.cli import execute
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor

SENSOR = Sensor(width=120, height=120)


def _write(image: RangeImage, path: Path) -> None:
    np.savez(path, points=np.where(image.valid[..., None], image.points, np.nan), valid=image.valid)


@pytest.fixture(scope="module")
def gourd(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], ObjectViews]:
    """Four neighbouring views of the gourd, and one of another object."""
    folder = tmp_path_factory.mktemp("gourd")
    views = ObjectViews("gourd", (0, 45, 90, 135), SENSOR, Laser(sigma=0.001), seed=1)
    for name in views.names:
        _write(views.scan(name), folder / f"{name}.npz")
    other = ObjectViews("y_pipe", (0,), SENSOR, Laser(sigma=0.001), seed=1)
    _write(other.scan(other.names[0]), folder / "other.npz")
    return [str(folder / f"{name}.npz") for name in (*views.names, "other")], views


def test_scans_come_into_one_frame(gourd, tmp_path, capsys):
    files, views = gourd
    shuffled = [files[k] for k in (2, 4, 0, 3, 1)]
    assert execute(["align", *shuffled, "--out", str(tmp_path / "run"), "--json"]) == 0
    shown = capsys.readouterr().out
    assert "note: no pair that is believed joins other.npz to the others" in shown
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    poses = json.loads((tmp_path / "run" / "poses.json").read_text())
    assert summary["left_out"] == ["other.npz"] and "other.npz" not in poses
    assert np.allclose(poses[f"{views.names[2]}.npz"], np.eye(4))
    first = views.T_world_scan(views.names[2])
    for name in views.names:
        true, found = inverse(first) @ views.T_world_scan(name), np.array(poses[f"{name}.npz"])
        assert rotation_angle_deg(found[:3, :3].T @ true[:3, :3]) < 0.3
        assert np.linalg.norm((found - true)[:3] @ [0, 0, 3, 1]) < 0.004
    merged = load_scan(tmp_path / "run" / "merged.ply")
    whole = sum(int(views.scan(name).valid.sum()) for name in views.names)
    assert len(merged.points) == whole and not isinstance(merged, RangeImage)
    import open3d

    assert open3d.io.read_point_cloud(str(tmp_path / "run" / "merged.ply")).has_normals()
    for name in ("manifest.json", "results.parquet", "report.html", "figures/merged.png", "figures/graph.png"):
        assert (tmp_path / "run" / name).stat().st_size > 0
    # a run that was killed before its end goes on to the same poses
    before = (tmp_path / "run" / "poses.json").read_bytes()
    (tmp_path / "run" / "summary.json").unlink()
    assert execute(["align", *shuffled, "--out", str(tmp_path / "run"), "--resume"]) == 0
    assert (tmp_path / "run" / "poses.json").read_bytes() == before
    assert execute(["report", str(tmp_path / "run")]) == 0


def test_orders_are_compared_with_the_truth(tmp_path, capsys):
    scans = "{kind: object, name: gourd, views: 6, sensor: {width: 120, height: 120}}"
    words = ["run", "multiview", "--scans", scans, "--orders", "[graph, chain, cycle_of_cycles, tournament]"]
    assert execute([*words, "--out", str(tmp_path / "run")]) == 0
    orders = {order["name"]: order for order in json.loads((tmp_path / "run" / "summary.json").read_text())["orders"]}
    assert all(order["views"] == 6 and order["turn_worst"] < 0.6 for order in orders.values())
    assert all(order["apart"] <= order["apart_first"] for order in orders.values())
    assert orders["graph"]["turn_worst"] < orders["chain"]["turn_worst_first"]
    assert "Orders of fusion" in capsys.readouterr().out
    assert (tmp_path / "run" / "figures" / "orders.png").is_file()


def test_one_scan_alone_copies_and_equal_names_are_refused(gourd, tmp_path, refused):
    files, _ = gourd
    assert "expected at least two scans" in refused("align", files[0], "--out", "out")
    (tmp_path / "copies").mkdir()
    shutil.copy(files[0], tmp_path / "copies" / "copy.npz")
    assert "hold the same points" in refused("align", files[0], files[1], "copies/copy.npz", "--out", "out")
    shutil.copy(files[1], tmp_path / "copies" / Path(files[0]).name)
    assert "have this file name" in refused("align", files[0], f"copies/{Path(files[0]).name}", "--out", "out")
    assert "absent.ply" in refused("align", files[0], "absent.ply", "--out", "out")


def test_scans_that_share_nothing_end_with_1(gourd, tmp_path, capsys):
    files, _ = gourd
    assert execute(["align", files[0], files[4], "--out", str(tmp_path / "run")]) == 1
    assert "no two of the scans could be registered" in capsys.readouterr().err


def test_unknown_orders_are_named(refused, tmp_path):
    raw = {"experiment": "multiview", "scans": {"kind": "object", "name": "gourd"}, "orders": ["spiral"]}
    (tmp_path / "bad.yaml").write_text(json.dumps(raw))
    assert "orders names 'spiral'" in refused("run", "bad.yaml", "--out", "out")


@pytest.mark.data
def test_five_bunny_scans_in_any_order(data_dir, tmp_path):
    """Every pose within half a degree and half a millimetre of bun.conf (all ten: ``experiments/README.md``)."""
    bunny = StanfordBunny(data_dir)
    names = ["top2", "bun045", "bun180", "bun090", "ear_back"]
    files = [str(bunny.path(name)) for name in names]
    truth = ["--truth", str(bunny.folder / "bun.conf")]
    assert execute(["align", *files, *truth, "--out", str(tmp_path / "run")]) == 0
    views = json.loads((tmp_path / "run" / "summary.json").read_text())["views"]
    assert all(view["placed"] and view["turn_deg"] < 0.5 and view["shift"] < 5e-4 for view in views)
