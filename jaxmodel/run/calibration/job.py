"""The experiment ``calibration``: hand-eye poses by every method, what the motions determine, and what to take.

``jaxmodel calibrate`` makes its configuration from words. The folder also has ``calibration.json`` (the recommended
answer) and ``motions.parquet``.
"""

import json
import time
from collections.abc import Mapping
from typing import Any

from jaxmodel.calibrate.solve import METHODS
from jaxmodel.io.results import RunDir, json_text
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.run.calibration import report as calibration_report
from jaxmodel.run.calibration.answers import find_answers
from jaxmodel.run.calibration.config import Config
from jaxmodel.run.calibration.input import load_poses
from jaxmodel.run.calibration.rows import motion_rows, pose_rows
from jaxmodel.run.calibration.summary import summarise
from jaxmodel.run.console import Progress
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.registry import Prepared
from jaxmodel.view.table import Table

__all__ = ["Config", "draw", "prepare", "tables"]


class Calibration(Prepared):
    """Poses read, checked and paired."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.poses = load_poses(config)
        self.inputs = hash_files(self.poses.files)
        self.resolved = unstructure(config)
        self.bytes_needed = 20_000_000

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Run every method and write all files of the folder, ``summary.json`` last."""
        begun = time.perf_counter()
        progress.begin("methods", len(METHODS) + 3 if self.config.method == "all" else 3)

        def done(what: str) -> None:
            progress.describe(f"{what} done")
            progress.advance(1)

        found = find_answers(self.config, self.poses, done)
        folder.write_table("motions.parquet", motion_rows(found))
        folder.write_table("results.parquet", pose_rows(self.poses, found))
        # as "jaxmodel report" will read it, so that it draws the same
        summary = json.loads(json_text(summarise(self.config, self.poses, found)))
        folder.write_json("calibration.json", summary["recommended"])
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        return summary


def prepare(config: Config) -> Calibration:
    """Read and check everything ``config`` names."""
    return Calibration(config)


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """All methods side by side, the verdict, the recommended answer, and the poses to look at."""
    return calibration_report.tables(summary)


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return calibration_report.draw(folder, summary)
