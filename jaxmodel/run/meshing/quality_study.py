"""The experiment ``mesh_quality`` (thesis §3.5, Table 3.2): ball pivoting against the deformable surface, and others.

Every cloud is meshed by every method; the passes of the ball and single radii against each other come with it. Table
3.2 gives triangles, both qualities and time; how far the points lie from the mesh, its border and its parts are added
here, since a mesh can have perfect triangles and be nowhere near the points.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.errors import InputError, RunError
from jaxmodel.io.mesh_writing import mesh_bytes
from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.mesh.adjacency import vertex_normals
from jaxmodel.mesh.distance import surface_distance, to_surface
from jaxmodel.mesh.quality import quality
from jaxmodel.mesh.radii import cloud_scale
from jaxmodel.run.console import Progress
from jaxmodel.run.meshing.ball_study import radius_sweep, sheet_of, thinning_for, timed_passes
from jaxmodel.run.meshing.clouds import Measured
from jaxmodel.run.meshing.making import make_mesh
from jaxmodel.run.meshing.options import Options
from jaxmodel.run.meshing.quality_report import draw, mesh_name
from jaxmodel.run.meshing.quality_tables import tables
from jaxmodel.run.meshing.registered_scans import Placed
from jaxmodel.run.meshing.study_objects import BuiltIn, ObjectSpec, Subject, make_subject
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.published import published_table
from jaxmodel.run.registry import Prepared
from jaxmodel.scan.triangle_mesh import ObjectMesh

__all__ = ["Config", "MeshQuality", "draw", "prepare", "tables"]

Method = Literal["ball", "ball_thinned", "deformable_5", "deformable_6", "marching_cubes", "poisson"]
_OPTIONS: Mapping[str, Options] = {
    "ball": Options("ball-pivoting"),
    "ball_thinned": Options("ball-pivoting"),
    "deformable_5": Options("deformable", order=5),
    "deformable_6": Options("deformable", order=6),
    "marching_cubes": Options("marching-cubes"),
    "poisson": Options("poisson"),
}
_DISTANCE_SAMPLES = 30_000


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment.

    ``ball_thinned`` first thins the cloud to as many points as the thesis's ball left vertices, which with a large ball
    passes over the others; it is left out where the thesis has no row. ``runs`` of each method: the least time counts.
    ``sweep`` names objects for single balls of ``radii`` (in spacings), ``passes`` those for the tables of passes.
    """

    experiment: Literal["mesh_quality"] = "mesh_quality"
    seed: int = 0
    objects: tuple[ObjectSpec, ...] = (BuiltIn("torso", "torso"),)
    methods: tuple[Method, ...] = ("ball", "ball_thinned", "deformable_5", "deformable_6", "marching_cubes", "poisson")
    runs: int = 2
    sweep: tuple[str, ...] = ()
    radii: tuple[float, ...] = (0.6, 0.75, 0.9, 1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0)
    passes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = [spec.name for spec in self.objects]
        for word, value, least in (("seed", self.seed, 0), ("runs", self.runs, 1)):
            if value < least:
                raise ValueError(f"{word} is {value}, expected {least} or more")
        if not names or not self.methods:
            raise ValueError("objects and methods must each name at least one")
        if len(set(names)) < len(names) or len(set(self.methods)) < len(self.methods):
            raise ValueError("objects and methods must each have different names")
        for name in (*self.sweep, *self.passes):
            if name not in names:
                raise ValueError(f"sweep and passes name {name!r}, expected one of {', '.join(names)}")
        known = published_table("mesh_quality")
        for spec in self.objects:
            if spec.stands_for and spec.stands_for not in known["objects"]:
                raise ValueError(f"stands_for is {spec.stands_for!r}, expected one of {', '.join(known['objects'])}")
            if spec.name in self.passes and spec.stands_for not in known["passes"]:
                raise ValueError(
                    f"passes names {spec.name!r}, expected one that stands for {' or '.join(known['passes'])}"
                )
        if any(not 0 < radius <= 10 for radius in self.radii):
            raise ValueError(f"radii is {list(self.radii)}, expected above 0 to 10 spacings")


class MeshQuality(Prepared):
    """All methods on all clouds; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.subjects = [make_subject(spec, config.seed) for spec in config.objects]
        self.inputs = hash_files([file for subject in self.subjects for file in subject.files])
        self.resolved = unstructure(config)
        self.bytes_needed = 200_000_000

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Mesh what is not yet meshed, write the table, the meshes, the pictures and ``summary.json``."""
        begun, config = time.perf_counter(), self.config
        progress.begin("meshes", len(self.subjects) * (len(config.methods) + 2))
        done = []
        balls: dict[str, dict[str, list[dict[str, Any]]]] = {"sweep": {}, "passes": {}}
        for number, subject in enumerate(self.subjects):
            key = f"object{number:03d}"
            parts = folder.read_parts(key)
            spacing = cloud_scale(subject.measured.points).spacing
            for place, method in enumerate(config.methods):
                progress.describe(f"{subject.name}, {method}")
                if method != "ball_thinned" or subject.stands_for:
                    if place not in parts:
                        parts[place] = _meshed(folder, subject, spacing, method, config.runs)
                        folder.write_part(key, place, parts[place])
                    done.append(parts[place])
                progress.advance(1)
            done.append(_referenced(folder, subject, spacing))
            progress.describe(f"{subject.name}, single balls and passes")
            for what, chosen, make in (("sweep", config.sweep, self._sweep), ("passes", config.passes, _passes)):
                if subject.name in chosen:
                    kept = folder.read_parts(f"{what}{number:03d}").get(0)
                    if kept is None:
                        kept = make(subject)
                        folder.write_part(f"{what}{number:03d}", 0, kept)
                    balls[what][subject.name] = kept.to_dicts()
                progress.advance(1)
        table = polars.concat([part for part in done if len(part)], how="diagonal")
        folder.write_table("results.parquet", table.drop("seconds"))  # times are no result: same seed, same bytes
        summary: dict[str, Any] = {
            "experiment": "mesh_quality",
            "stands_for": {subject.name: subject.stands_for for subject in self.subjects},
            "registered": {
                subject.name: {name: _placed(placed) for name, placed in subject.registered.items()}
                for subject in self.subjects
                if subject.registered
            },
            "clouds": {subject.name: _cloud_facts(subject.measured) for subject in self.subjects},
            "rows": table.to_dicts(),
            **balls,
        }
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["total_seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _sweep(self, subject: Subject) -> polars.DataFrame:
        return polars.DataFrame(radius_sweep(sheet_of(subject.measured), self.config.radii))


def prepare(config: Config) -> MeshQuality:
    """Read and check everything ``config`` names."""
    return MeshQuality(config)


def _cloud_facts(measured: Measured) -> dict[str, int | float]:
    scale = cloud_scale(measured.points)
    return {
        "points": len(measured.points),
        "spacing": scale.spacing,
        "nearest": scale.nearest / scale.spacing,
        "thickness": scale.thickness / scale.spacing,
        "size": float(np.ptp(measured.points, axis=0).max()),
    }


def _placed(placed: Placed) -> dict[str, float]:
    return {key: value for key, value in placed._asdict().items() if key != "T_world_scan"}


def _passes(subject: Subject) -> polars.DataFrame:
    """The thesis's growth of the radius, on the points as they are (as the thesis did) and on one sheet of them."""
    radius = published_table("mesh_quality")["passes"][subject.stands_for]["radius"]
    rows = []
    for thinned in (False, True):
        sheet = sheet_of(subject.measured, thinned)
        for row in timed_passes(sheet, [one / radius[0] for one in radius]):
            rows.append({"thinned": thinned, "points": len(sheet.points), **row})
    return polars.DataFrame(rows)


def _meshed(folder: RunDir, subject: Subject, spacing: float, method: str, runs: int) -> polars.DataFrame:
    """One method on one cloud, its mesh written; a method that fails leaves its sentence."""
    options = _OPTIONS[method]
    if method == "ball_thinned":
        wanted = published_table("mesh_quality")["objects"][subject.stands_for]["ball"]["vertices"]
        options = options._replace(thinning=thinning_for(subject.measured, wanted) or None)
    times, made, failure = [], None, ""
    for _ in range(runs):
        begun = time.process_time()  # Table 3.2 gives processor time, which other work on the machine lengthens less
        try:
            made = make_mesh(subject.measured, options)
        except (InputError, RunError) as error:
            failure = str(error)
            break
        times.append(time.process_time() - begun)
    if made is None:
        return polars.DataFrame([{"object": subject.name, "method": method, "sentence": failure, "seconds": np.nan}])
    folder.write(mesh_name(subject.name, method), mesh_bytes(made.mesh, ".ply", made.normals))
    about = {"seconds": min(times), "sentence": made.sentence, "thinned": made.points.get("thinning_distance", 0.0)}
    return polars.DataFrame([{**_measures(made.mesh, subject, spacing, method), **about}])


def _referenced(folder: RunDir, subject: Subject, spacing: float) -> polars.DataFrame:
    """The meshes made elsewhere, and the true surface, measured alike."""
    known = dict(subject.references)
    if subject.truth is not None:
        known["the true mesh"] = subject.truth
    rows = []
    for label, mesh in known.items():
        rows.append(_measures(mesh, subject, spacing, label) | {"seconds": np.nan, "sentence": "", "thinned": 0.0})
        folder.write(mesh_name(subject.name, label), mesh_bytes(mesh, ".ply", vertex_normals(mesh)))
    return polars.DataFrame(rows)


def _measures(mesh: ObjectMesh, subject: Subject, spacing: float, method: str) -> dict[str, Any]:
    """A mesh in numbers; lengths in spacings of the cloud."""
    measures = quality(mesh)
    away = to_surface(subject.measured.points, mesh) / spacing
    row: dict[str, Any] = {
        "object": subject.name,
        "method": method,
        "vertices": measures.vertices - measures.unused_vertices,
        "triangles": measures.triangles,
        "Q_equ": measures.Q_equ,
        "Q_nor": measures.Q_nor,
        "points_mean": float(away.mean()),
        "points_95": float(np.quantile(away, 0.95)),
        "points_most": float(away.max()),
        "border_length": measures.border_length / spacing,
        "border_loops": measures.border_loops,
        "components": measures.components,
        "largest_share": measures.largest_share,
        "euler": measures.euler,
        "Q_equ_counts": measures.Q_equ_histogram.counts.tolist(),
        "Q_nor_counts": measures.Q_nor_histogram.counts.tolist(),
        "truth_there": np.nan,
        "truth_back": np.nan,
    }
    if subject.truth is not None and mesh is not subject.truth:
        apart = surface_distance(mesh, subject.truth, _DISTANCE_SAMPLES)
        row |= {"truth_there": apart.there.mean / spacing, "truth_back": apart.back.mean / spacing}
    return row
