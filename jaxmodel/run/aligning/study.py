"""The experiment ``multiview``: whole sets of scans in one frame, no pose known (thesis §2.8, Table 5.3).

Every pair is searched with no first guess, the believed ones join the views, and all are placed: by the graph of all
pairs and all points at once, which is what ``jaxmodel align`` does, and by the thesis's orders of fusion beside it.
"""

import time
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.errors import RunError
from jaxmodel.geometry.se3 import inverse
from jaxmodel.io.mesh_writing import mesh_bytes
from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.register.candidates import PairOfViews
from jaxmodel.register.multiview.view_graph import Edge, edge_of, placed, triangles
from jaxmodel.register.search import SearchOptions, search_pair, views_of
from jaxmodel.register.verdict import Found, SearchOutcome
from jaxmodel.register.view_of_scan import ViewOfScan
from jaxmodel.run.aligning.orders import ORDERS, Way, all_ways
from jaxmodel.run.aligning.pictures import keep_views
from jaxmodel.run.aligning.report import draw, tables
from jaxmodel.run.aligning.summary import summarised
from jaxmodel.run.aligning.view_sets import Sets, load_set
from jaxmodel.run.console import Progress
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.registry import Prepared
from jaxmodel.scan.triangle_mesh import ObjectMesh

__all__ = ["Config", "MultiviewStudy", "draw", "prepare", "tables"]


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment; the first of ``orders`` gives the poses that are written."""

    scans: Sets
    experiment: Literal["multiview"] = "multiview"
    seed: int = 0
    orders: tuple[str, ...] = ("graph",)
    search: SearchOptions = field(default_factory=SearchOptions)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        if not self.orders:
            raise ValueError("orders is empty, expected at least one")
        for order in self.orders:
            if order not in ORDERS:
                raise ValueError(f"orders names {order!r}, expected some of {', '.join(ORDERS)}")


class MultiviewStudy(Prepared):
    """One set of scans; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.set = load_set(config.scans, config.seed)
        self.inputs = hash_files(dict.fromkeys(self.set.files))
        self.resolved = unstructure(config)
        self.bytes_needed = 50_000_000
        self.views, self.length = views_of(self.set.scans)

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Search the pairs not yet searched, place all views, write poses, cloud, table, pictures and summary."""
        begun, names = time.perf_counter(), list(self.set.scans)
        views = [self.views[name] for name in names]
        pairs = list(combinations(range(len(names)), 2))
        progress.begin("pairs", len(pairs))
        rows, edges = [], []
        for number, (target, source) in enumerate(pairs):
            progress.describe(f"{names[target]}, {names[source]}")
            parts = folder.read_parts(f"pair{number:05d}")
            if 0 not in parts:
                row = _searched(views, target, source, self.length, self.config.search)
                parts[0] = polars.DataFrame([{"target": names[target], "source": names[source], **row}])
                folder.write_part(f"pair{number:05d}", 0, parts[0])
            rows.append(parts[0])
            edges += _edge(target, source, parts[0].row(0, named=True))
            progress.advance(1)
        table = polars.concat(rows, how="vertical")
        searching = time.perf_counter() - begun
        centres = np.stack([view.centre for view in views])
        first = placed(edges, centres, self.length)
        members = np.flatnonzero(first.part == 0)
        if len(members) < 2:
            raise RunError("no two of the scans could be registered with each other, so nothing was aligned")
        progress.describe("all views at once")
        kept_edges = [edge for k, edge in enumerate(edges) if k not in first.doubtful]
        ways = all_ways(self.config.orders, views, kept_edges, members, self.length, self.config.seed)
        folder.write_table("results.parquet", table.drop("seconds"))
        self._write(folder, names, views, ways[0])
        summary = summarised(
            names, views, self.length, table, edges, first, triangles(edges, centres), ways, self._truth(members)
        )
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["search_seconds"] = round(searching, 3)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _truth(self, members: np.ndarray) -> np.ndarray | None:
        """True poses relative to the first of the views that hang together."""
        T = self.set.T_world_view
        return None if T is None else inverse(T[members[0]]) @ T

    def _write(self, folder: RunDir, names: list[str], views: list[ViewOfScan], way: Way) -> None:
        poses, points, normals, numbers = {}, [], [], []
        for k, (name, view, T) in enumerate(zip(names, views, way.T_world_view, strict=True)):
            if not np.isfinite(T).all():
                continue
            poses[name] = T.tolist()
            moved = view.whole.moved(T)
            points.append(moved.points)
            normals.append(moved.normals)
            numbers.append(np.full(len(moved.points), k))
        folder.write_json("poses.json", poses)
        cloud = np.concatenate(points), np.concatenate(normals)
        folder.write("merged.ply", mesh_bytes(ObjectMesh(cloud[0], np.zeros((0, 3), np.int64)), ".ply", cloud[1]))
        keep_views(folder, cloud[0], np.concatenate(numbers))


def prepare(config: Config) -> MultiviewStudy:
    """Read and check everything ``config`` names."""
    return MultiviewStudy(config)


def _searched(
    views: list[ViewOfScan], target: int, source: int, length: float, options: SearchOptions
) -> dict[str, Any]:
    begun = time.perf_counter()
    found: Found = search_pair(PairOfViews(views[target], views[source], length), options)
    return {
        **{f"T_{i}{j}": float(found.T_target_source[i, j]) for i in range(3) for j in range(4)},
        "outcome": int(found.outcome),
        "probability": found.probability,
        "overlap_target": found.overlap[0],
        "overlap_source": found.overlap[1],
        "contradicted": found.contradicted,
        "scatter": found.scatter,
        "rival": found.rival,
        "equivalents": len(found.equivalents),
        "seconds": time.perf_counter() - begun,
    }


def _edge(target: int, source: int, row: dict[str, Any]) -> list[Edge]:
    T = np.eye(4)
    T[:3] = [[row[f"T_{i}{j}"] for j in range(4)] for i in range(3)]
    overlap = (row["overlap_target"], row["overlap_source"])
    none = np.zeros((0, 4, 4))
    found = Found(
        T, SearchOutcome(row["outcome"]), row["probability"], overlap, row["contradicted"], row["scatter"], 0.0, none
    )
    return edge_of(target, source, found)
