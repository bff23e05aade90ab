"""The experiment ``next_view_search`` in small: methods against a field, resume, report, bad input."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
import yaml

from jaxmodel.run.cli import execute
from jaxmodel.run.planning import search_study
from jaxmodel.run.planning.search_study import Config, summarised

SMALL: dict[str, Any] = {
    "experiment": "next_view_search",
    "objects": ["valve", "gourd"],
    "maps": 2,
    "field_views": 1500,
    "methods": ["pattern", "views", "hill_climbing"],
    "scene": {"pixels": 64, "cells": 32, "samples": 500, "reaching": 60},
    "search": {"views": 150, "spiral": 8, "rays": 256, "best": 4, "rounds": 4},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("next_view_search")
    (place / "small.yaml").write_text(yaml.safe_dump(SMALL))
    assert execute(["run", str(place / "small.yaml"), "--out", str(place / "run")]) == 0
    return place


def test_the_search_reaches_the_field_and_beats_what_it_started_from(folder: Path) -> None:
    rows = polars.read_parquet(folder / "run" / "results.parquet")
    ratio = {str(method): of["ratio"].to_numpy() for (method,), of in rows.group_by(["method"])}
    assert {len(of) for of in ratio.values()} == {4}
    assert np.mean(ratio["pattern"] > ratio["views"]) >= 0.75 and ratio["pattern"].min() > 0.95
    assert ratio["views"].mean() < ratio["pattern"].mean() <= 1.2
    assert (ratio["hill_climbing"] < 1.2).all()


def test_the_field_is_kept_with_what_it_is_the_best_of(folder: Path) -> None:
    rows = polars.read_parquet(folder / "run" / "results.parquet").filter(polars.col("object") == "valve")
    field = polars.read_parquet(folder / "run" / "field.parquet")
    assert len(field) == 2 * 1500 and set(field["object"]) == {"valve"}
    for number in (1, 2):
        able = field.filter((polars.col("map") == number) & polars.col("overlaps"))
        best = rows.filter(polars.col("map") == number)["field_best"].to_numpy()
        np.testing.assert_allclose(best, able["value"].to_numpy().max(), rtol=1e-6)


def test_report_and_figures(folder: Path) -> None:
    summary = json.loads((folder / "run" / "summary.json").read_text())
    assert set(summary["figures"]) == {"figures/ratios.png", "figures/preference.png", "figures/field.png"}
    assert [of["method"] for of in summary["methods"]] == SMALL["methods"]
    page = (folder / "run" / "report.html").read_text()
    assert "views, then pattern" in page and "best of 1500 views" in page


def test_an_interrupted_run_goes_on_to_the_same_bytes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    whole = search_study.SearchStudy._run

    def stops(self: Any, scene: Any, start: int, progress: Any) -> Any:
        if scene.name == "gourd" and not made:
            made.append("stopped")
            raise KeyboardInterrupt
        return whole(self, scene, start, progress)

    monkeypatch.setattr(search_study.SearchStudy, "_run", stops)
    out = str(folder / "again")
    assert execute(["run", str(folder / "small.yaml"), "--out", out]) == 130
    assert execute(["run", str(folder / "small.yaml"), "--resume", out]) == 0
    for name in ("results.parquet", "field.parquet"):
        assert (folder / "again" / name).read_bytes() == (folder / "run" / name).read_bytes()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"maps": 0}, "maps is 0, expected at least 1"),
        ({"methods": ("guess",)}, "methods names 'guess'"),
        ({"objects": ()}, "objects must name at least one"),
        ({"starts": 9}, "starts is 9, expected 1 to 7"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_bad_configurations_are_told(changed: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        Config(**changed)


def test_a_summary_counts_the_maps_that_reach_the_best() -> None:
    ratio = [1.0, 0.99, 0.98, 1.01]
    rows = polars.DataFrame({"method": ["a"] * 4, "ratio": ratio, "scored": [1] * 4, "seconds": [1.0] * 4})
    (of,) = summarised(rows)
    assert of["reached"] == 0.75 and of["worst"] == 0.98 and of["maps"] == 4
