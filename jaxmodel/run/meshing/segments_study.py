"""The experiment ``mesh_segments``: clouds of several views to one segmented mesh (thesis Table 5.2, §3.3, §5.3).

Every scene is meshed by ball pivoting and its segments are counted beside the true and the published numbers.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, cast

import numpy as np
import polars

from jaxmodel.io.mesh_writing import mesh_bytes
from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.mesh.adjacency import vertex_normals
from jaxmodel.mesh.ball_pivoting import Pivoting, ball_pivoting
from jaxmodel.mesh.from_meshes import pivot_views
from jaxmodel.mesh.lying_over import lying_over
from jaxmodel.mesh.quality import quality
from jaxmodel.mesh.segmentation import Segmentation, segment
from jaxmodel.run.console import Progress
from jaxmodel.run.meshing.colours import face_colours, number_colours
from jaxmodel.run.meshing.drawing_data import Drawn, keep
from jaxmodel.run.meshing.grown_border import Views, grow_from_border, read_views
from jaxmodel.run.meshing.method_facts import METHODS, method_facts
from jaxmodel.run.meshing.plane_count import different_planes
from jaxmodel.run.meshing.scenes import SCENES, Errors, Scene, make_scene
from jaxmodel.run.meshing.segments_report import draw, tables
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.registry import Prepared
from jaxmodel.scan.triangle_mesh import ObjectMesh, join

__all__ = ["Config", "MeshSegments", "draw", "prepare", "tables"]


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment.

    ``offset`` and ``tilt_deg``: registration errors of the views of planes (spacings of their grid, degrees).
    ``pixels`` across the images of the solids, ``registration`` errors of these views as shares of the size.
    ``least_share``: segments below this share of the area are counted apart. ``methods`` are compared on clouds of
    ``method_points``, the deformable surface of ``order`` as the thesis counts. ``grow``: whose four views make
    Fig. 3.1, of every ``every``-th row and column; "none" leaves it out.
    """

    experiment: Literal["mesh_segments"] = "mesh_segments"
    seed: int = 0
    scenes: tuple[str, ...] = tuple(SCENES)
    offset: float = 0.15
    tilt_deg: float = 0.5
    pixels: int = 48
    registration: float = 0.0005
    least_share: float = 0.05
    methods: tuple[str, ...] = tuple(METHODS)
    method_points: int = 6000
    order: int = 5
    grow: Literal["bunny", "boulder", "none"] = "bunny"
    every: int = 3

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        if not self.scenes:
            raise ValueError("scenes must name at least one")
        for key in ("offset", "tilt_deg", "registration"):
            value = getattr(self, key)
            if not 0 <= value < 1:
                raise ValueError(f"{key} is {value}, expected 0 or more and less than 1")
        if not 16 <= self.pixels <= 1000:
            raise ValueError(f"pixels is {self.pixels}, expected 16 to 1000")
        for method in self.methods:
            if method not in METHODS:
                raise ValueError(f"methods names {method!r}, expected some of {', '.join(METHODS)}")
        if self.method_points < 500:
            raise ValueError(f"method_points is {self.method_points}, expected 500 or more")
        if not 2 <= self.order <= 7:
            raise ValueError(f"order is {self.order}, expected 2 to 7")
        if not 1 <= self.every <= 10:
            raise ValueError(f"every is {self.every}, expected 1 to 10")
        if not 0 <= self.least_share < 1:
            raise ValueError(f"least_share is {self.least_share}, expected 0 or more and less than 1")


class MeshSegments(Prepared):
    """All scenes; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        errors = Errors(config.offset, config.tilt_deg, config.pixels, config.registration)
        self.scenes = {name: make_scene(name, errors, config.seed) for name in config.scenes}
        self.views = None if config.grow == "none" else read_views(config.grow, config.every)
        self.inputs = hash_files([] if self.views is None else self.views.files)
        self.resolved = unstructure(config)
        self.bytes_needed = 50_000_000

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Mesh what is not yet done, write the table, the meshes, the pictures and ``summary.json``."""
        begun, config = time.perf_counter(), self.config
        progress.begin("scenes", len(self.scenes) + len(config.methods) + (self.views is not None))
        warmed = False

        def done(key: str, make: Callable[[], list[dict[str, Any]]]) -> polars.DataFrame:
            nonlocal warmed
            parts = folder.read_parts(key)
            if 0 not in parts:
                if not warmed:
                    _warm()
                    warmed = True
                parts[0] = polars.DataFrame(make())
                folder.write_part(key, 0, parts[0])
            progress.advance(1)
            return parts[0]

        scenes, methods, grown = [], [], []
        for number, (name, scene) in enumerate(self.scenes.items()):
            progress.describe(name)
            scenes.append(done(f"scene{number:03d}", lambda n=name, s=scene: [self._row(folder, n, s)]))
        for number, method in enumerate(config.methods):
            progress.describe(method)
            make = partial(method_facts, method, config.method_points, config.order, config.seed)
            methods.append(done(f"method{number:03d}", lambda make=make: [make()]))
        if self.views is not None:
            progress.describe(f"growth of {config.grow}")
            grown.append(done("growth", lambda: _grow(folder, cast(Views, self.views))))
        table = polars.concat(scenes, how="vertical")
        folder.write_table("results.parquet", table.drop("seconds"))  # times are no result: same seed, same bytes
        summary: dict[str, Any] = {
            "experiment": "mesh_segments",
            "least_share": config.least_share,
            "scenes": table.to_dicts(),
            "methods": [row for one in methods for row in one.to_dicts()],
            "grow": config.grow,
            "growth": [row for one in grown for row in one.to_dicts()],
        }
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _row(self, folder: RunDir, name: str, scene: Scene) -> dict[str, Any]:
        """One scene meshed and cut up; its mesh goes to the folder."""
        before = join(*scene.views)
        begun = time.perf_counter()
        made = pivoted(scene)
        found = segment(made.mesh, scene.noise)
        seconds = time.perf_counter() - begun
        mesh = made.mesh
        measures = quality(mesh)
        _keep(folder, name, scene, found)
        large = [one for one in found.primitives if one.area >= self.config.least_share * measures.area]
        return {
            "scene": name,
            "views": len(scene.views),
            "points": len(before.vertices),
            "before": len(before.faces),
            "lying_over_before": int(lying_over(before.vertices, before.faces).sum()),
            "thinned": made.thinned,
            "vertices": len(mesh.vertices),
            "after": len(mesh.faces),
            "lying_over": int(lying_over(mesh.vertices, mesh.faces).sum()),
            "components": measures.components,
            "border_loops": measures.border_loops,
            "all_segments": len(found.primitives),
            "segments": len(large),
            "expected_segments": scene.segments,
            "planes": different_planes(mesh, large, scene.noise or found.noise),
            "expected_planes": scene.planes,
            "plane_area": sum(one.area for one in large if one.kind == "plane") / measures.area,
            "noise": found.noise,
            "seconds": seconds,
        }


def prepare(config: Config) -> MeshSegments:
    """Make and check everything ``config`` names."""
    return MeshSegments(config)


def pivoted(scene: Scene) -> Pivoting:
    """The scene by ball pivoting: from the views' meshes where they have some, else from the points alone."""
    thinning = cast(Any, "auto" if scene.thinning is None else scene.thinning)
    if scene.normals is None or scene.eyes is None:
        return pivot_views(scene.views, thinning=thinning)
    sizes = [len(view.vertices) for view in scene.views]
    start = np.cumsum([0, *sizes])
    seeds = [view.faces + offset for view, offset in zip(scene.views, start[:-1], strict=True)]
    return ball_pivoting(
        np.concatenate([view.vertices for view in scene.views]),
        np.concatenate(scene.normals),
        eyes=np.concatenate([np.tile(eye, (size, 1)) for eye, size in zip(scene.eyes, sizes, strict=True)]),
        seeds=np.concatenate(seeds) if any(map(len, seeds)) else None,
        thinning=thinning,
    )


def _warm() -> None:
    """Load and compile what the first mesh would pay for."""
    scene = make_scene("one_plane", Errors(0.1, 0.5, 16, 0.0), 0)
    segment(pivoted(scene).mesh, scene.noise)


def _grow(folder: RunDir, views: Views) -> list[dict[str, Any]]:
    """View 1's mesh and what it grew to, kept for the picture."""
    grown = grow_from_border(views)
    first = np.zeros(len(grown.first.faces), np.int64)
    keep(
        folder,
        "growth",
        views=Drawn(*_arrays(grown.first), number_colours(first)),
        mesh=Drawn(*_arrays(grown.mesh), number_colours(grown.owner)),
    )
    return grown.rows


def _keep(folder: RunDir, name: str, scene: Scene, found: Segmentation) -> None:
    """The mesh as a file to open elsewhere, and what its pictures need."""
    colours = face_colours(found)
    folder.write(f"meshes/{name}.ply", mesh_bytes(found.mesh, ".ply", vertex_normals(found.mesh), colours))
    views = join(*scene.views)
    sizes = [len(view.faces) or len(view.vertices) for view in scene.views]
    of_view = number_colours(np.arange(len(sizes)))[np.repeat(np.arange(len(sizes)), sizes)]
    keep(folder, name, views=Drawn(*_arrays(views), of_view), mesh=Drawn(*_arrays(found.mesh), colours))


def _arrays(mesh: ObjectMesh) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
