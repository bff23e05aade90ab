"""A hand-eye run: chunks, resume and bad input."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

from jaxmodel.io.results import RunDir
from jaxmodel.run.cli import execute
from jaxmodel.run.hand_eye.averaging import Config, prepare
from jaxmodel.run.hand_eye.study import HandEyeStudy, Measured

SMALL: dict[str, Any] = {
    "experiment": "hand_eye_averaging", "draws": 5, "chunk": 2, "estimates": 4, "outliers": [0.0],
}  # fmt: skip


def run(folder: Path, **changes: Any) -> Path:
    folder.mkdir()
    (folder / "study.yaml").write_text(json.dumps({**SMALL, **changes}))
    assert execute(["run", str(folder / "study.yaml"), "--out", str(folder / "out")]) == 0
    return folder / "out"


def test_chunks_change_no_row(tmp_path: Path) -> None:
    one, other = run(tmp_path / "one"), run(tmp_path / "other", chunk=5)
    tables = [(out / "results.parquet").read_bytes() for out in (one, other)]
    assert tables[0] == tables[1] and not (one / "parts").exists()
    rows = polars.read_parquet(one / "results.parquet")
    assert len(rows) == 3 * 5 and rows["draw"].to_list() == [0, 1, 2, 3, 4] * 3


def test_a_killed_run_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = run(tmp_path / "whole")
    measured: list[tuple[str, int]] = []

    def spied(config: Config, most: int) -> HandEyeStudy:
        study = prepare(config)

        def measure(cell: Any) -> Callable[[int, int], Measured]:
            def one(first: int, count: int) -> Measured:
                if len(measured) == most:
                    raise KeyboardInterrupt
                measured.append((cell.labels["rotation"], first))
                return cell.measure(first, count)

            return one

        study.cells = [cell._replace(measure=measure(cell)) for cell in study.cells]
        return study

    (tmp_path / "study.yaml").write_text(json.dumps(SMALL))
    out = tmp_path / "out"
    monkeypatch.setattr("jaxmodel.run.hand_eye.averaging.prepare", lambda config: spied(config, 4))
    assert execute(["run", str(tmp_path / "study.yaml"), "--out", str(out)]) == 130
    assert not (out / "summary.json").exists() and len(list((out / "parts").glob("*.parquet"))) == 4
    monkeypatch.setattr("jaxmodel.run.hand_eye.averaging.prepare", lambda config: spied(config, 100))
    assert execute(["run", str(tmp_path / "study.yaml"), "--resume", str(out)]) == 0
    assert len(measured) == len(set(measured)) == 9
    assert (out / "results.parquet").read_bytes() == (whole / "results.parquet").read_bytes()


@pytest.mark.parametrize(
    ("experiment", "changes", "sentence"),
    [
        ("hand_eye_noise", {"draws": 1}, "draws is 1, expected 2 or more"),
        ("hand_eye_noise", {"report_draws": 20_000}, "expected at most draws, 10000"),
        ("hand_eye_noise", {"noise": [0.0]}, "noise holds nothing above 0"),
        ("hand_eye_noise", {"small": {"angle": 0.0, "length": 1.0}}, "expected angle > 0"),
        ("hand_eye_count", {"counts": [1]}, "numbers of motions from 2 to 16"),
        ("hand_eye_trajectories", {"bench": {"pixel_noise": 0.0}}, "pixel_noise is 0.0, expected above 0"),
        ("hand_eye_trajectories", {"bench": {"reference_images": 40}}, "reference_images is 40, expected 4 to 17"),
        ("hand_eye_trajectories", {"weights": [{"penalty": 0.0}]}, "penalty is 0.0, expected above 0"),
        ("hand_eye_trajectories", {"steps": 63}, "expected at most 62 steps"),
        ("hand_eye_self_calibration", {"scales": [0.0]}, "scales above 0"),
        ("hand_eye_self_calibration", {"scene_size": 0.0}, "scene_size is 0.0, expected above 0"),
        ("hand_eye_averaging", {"outliers": [0.6]}, "outliers from 0 to below 0.5"),
        ("hand_eye_observability", {"noise": 0.0}, "noise is 0.0, expected above 0"),
        ("hand_eye_observability", {"draw": 3}, "draws"),
    ],
)
def test_bad_configurations_are_refused(
    refused: Callable[..., str], tmp_path: Path, experiment: str, changes: dict[str, Any], sentence: str
) -> None:
    (tmp_path / "study.yaml").write_text(json.dumps({"experiment": experiment, **changes}))
    assert sentence in refused("run", "study.yaml", "--out", "out")


def test_a_cell_measures_the_same_draws_in_any_chunk() -> None:
    cell = prepare(Config(draws=4, estimates=4)).cells[0]
    whole, parts = cell.measure(0, 4).columns, [cell.measure(first, 2).columns for first in (0, 2)]
    for name, values in whole.items():
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), values)


def test_reports_are_drawn_from_the_folder_alone(tmp_path: Path) -> None:
    out = run(tmp_path / "run")
    figure = (out / "figures" / "means.png").read_bytes()
    (out / "figures" / "means.png").unlink()
    assert execute(["report", str(out)]) == 0
    assert (out / "figures" / "means.png").read_bytes() == figure
    with RunDir.resume(out) as folder:
        assert folder.finished()
