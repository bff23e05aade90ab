"""The experiment ``edges`` (thesis §2.4.1): how right the map of edges is, on solids whose edges are known.

Every solid is scanned from many sides at every noise, alone and before a wall; on smooth solids every crease is false.
The thesis shows pictures of its maps and gives no numbers, so ours stand beside what is asked of the detection.
"""

import time
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.control_points.edge_score import EdgeTruth, edge_score, edge_truth
from jaxmodel.control_points.edges import find_edges
from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.run.chapter2.edge_quality_report import draw, tables
from jaxmodel.run.console import Progress
from jaxmodel.run.registry import Prepared
from jaxmodel.scan.known_solids import before_a_wall, known_solid
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh
from jaxmodel.scan.visible_edges import visible_edges

__all__ = ["Config", "EdgeQuality", "draw", "prepare", "tables"]

_AWAY = 3.0  # the solids' longest side is 1
_ABOVE_DEG = (20.0, 65.0)


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment.

    ``noises``: standard deviations along the ray as shares of the size (a solid's longest side). ``views``: how many
    random places of the sensor, three sizes away and 20 to 65 degrees above, each with and without a wall behind.
    """

    experiment: Literal["edges"] = "edges"
    seed: int = 0
    solids: tuple[str, ...] = ("box", "stepped_block", "cylinder")
    smooth: tuple[str, ...] = ("ball", "plate")
    noises: tuple[float, ...] = (0.0, 0.001, 0.002, 0.005, 0.01)
    views: int = 12
    sensor: Sensor = field(default_factory=Sensor)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        if self.views < 1:
            raise ValueError(f"views is {self.views}, expected 1 or more")
        if not self.solids or not self.noises:
            raise ValueError("solids and noises must each name at least one")
        for sigma in self.noises:
            if not 0 <= sigma < 1:
                raise ValueError(f"noises holds {sigma}, expected shares of the size from 0 to below 1")


@dataclass(frozen=True)
class _Subject:
    name: str
    wall: bool
    smooth: bool
    mesh: ObjectMesh


class EdgeQuality(Prepared):
    """All views of all solids; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.subjects = []
        for name in (*config.solids, *config.smooth):
            mesh, smooth = known_solid(name), name in config.smooth
            self.subjects += [
                _Subject(name, wall, smooth, before_a_wall(mesh) if wall else mesh)
                for wall in ((False,) if smooth else (False, True))
            ]
        self.inputs = {}
        self.resolved = unstructure(config)
        self.bytes_needed = 5_000_000

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Score what is not yet done, write the table, the pictures and ``summary.json``."""
        begun, config = time.perf_counter(), self.config
        progress.begin("views", len(self.subjects) * config.views)
        done = []
        for number, subject in enumerate(self.subjects):
            progress.describe(subject.name)
            key = f"view{number:03d}"
            parts = folder.read_parts(key)
            progress.advance(len(parts))
            for view in range(config.views):
                if view not in parts:
                    parts[view] = self._rows(subject, view)
                    folder.write_part(key, view, parts[view])
                    progress.advance(1)
                done.append(parts[view])
        table = polars.concat(done, how="vertical")
        folder.write_table("results.parquet", table.drop("seconds"))  # times are no result: same seed, same bytes
        summary: dict[str, Any] = {
            "experiment": "edges",
            "views": config.views,
            "pixels": [config.sensor.height, config.sensor.width],
            "median_seconds": float(np.median(table["seconds"].to_numpy())),
            "scores": _scores(table.filter(~polars.col("smooth"))),
            "smooth": _false_creases(table.filter(polars.col("smooth"))),
        }
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _rows(self, subject: _Subject, view: int) -> polars.DataFrame:
        """One view of one solid at every noise."""
        import jax

        config, mesh = self.config, subject.mesh
        pose = _sensor_pose(config.seed, view)
        clean = scan_mesh(mesh.vertices, mesh.faces, config.sensor, pose)
        truth = None
        if not subject.smooth:
            truth = edge_truth(clean, visible_edges(mesh, config.sensor, pose), 1 / config.sensor.focal_px)
        key = jax.random.fold_in(jax.random.key(config.seed), view)
        rows = []
        for sigma in config.noises:
            laser = Laser(sigma=sigma, unit="data")
            image = scan_mesh(mesh.vertices, mesh.faces, config.sensor, pose, laser, key)
            begun = time.perf_counter()
            found = find_edges(image)
            seconds = time.perf_counter() - begun
            score = edge_score(found, truth or EdgeTruth(*_NOTHING))
            rows.append(
                {
                    "solid": subject.name,
                    "wall": subject.wall,
                    "smooth": subject.smooth,
                    "view": view,
                    "noise": sigma,
                    **score._asdict(),
                    "seconds": seconds,
                }
            )
        return polars.DataFrame(rows)


_NOTHING = np.zeros((0, 2)), np.zeros(0, bool), np.zeros(0, bool), np.zeros((0, 2))


def prepare(config: Config) -> EdgeQuality:
    """Read and check everything ``config`` names."""
    return EdgeQuality(config)


def _sensor_pose(seed: int, view: int) -> np.ndarray:
    """T_world_sensor of a view: anywhere around, 20 to 65 degrees above, turned anyhow about its axis."""
    rng = np.random.default_rng([seed, view])
    around, up = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(*_ABOVE_DEG))
    place = _AWAY * np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    return look_at(place, np.zeros(3), rng.normal(size=3))


def _scores(table: polars.DataFrame) -> list[dict[str, Any]]:
    """Mean and least of each score over the views, solid by solid and noise by noise; NaN where nothing counts."""
    found = []
    for (solid, sigma), of in table.group_by("solid", "noise", maintain_order=True):
        scores = {}
        for name in ("precision", "recall", "crease_recall", "labels"):
            values = of[name].to_numpy()
            values = values[np.isfinite(values)]
            scores[name] = {
                "mean": float(values.mean()) if len(values) else float("nan"),
                "least": float(values.min()) if len(values) else float("nan"),
                "views": len(values),
            }
        found.append({"solid": solid, "noise": sigma, **scores})
    return found


def _false_creases(table: polars.DataFrame) -> list[dict[str, Any]]:
    """The most crease pixels of any view of a smooth solid, by noise."""
    return [
        {"solid": solid, "noise": sigma, "most_creases": int(of["creases"].to_numpy().max()), "views": len(of)}
        for (solid, sigma), of in table.group_by("solid", "noise", maintain_order=True)
    ]
