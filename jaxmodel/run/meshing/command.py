"""``jaxmodel mesh``: from its words to the mesh and the files beside it."""

import time
from pathlib import Path

from jaxmodel.io.mesh_writing import mesh_bytes
from jaxmodel.io.meshes import load_mesh
from jaxmodel.io.results import json_text
from jaxmodel.mesh.distance import surface_distance
from jaxmodel.mesh.quality import quality
from jaxmodel.run import console
from jaxmodel.run.meshing.arguments import Mesh
from jaxmodel.run.meshing.clouds import Measured, read_clouds
from jaxmodel.run.meshing.colours import face_colours
from jaxmodel.run.meshing.content import Result, outcome, quality_tree, segments_tree
from jaxmodel.run.meshing.making import make_mesh
from jaxmodel.run.meshing.options import Options, read_options
from jaxmodel.run.meshing.places import Places, places_of, refuse, write_all
from jaxmodel.run.meshing.tables import tables
from jaxmodel.scan.triangle_mesh import ObjectMesh

STEPS = ("reading", "meshing", "measuring", "writing")


def mesh(command: Mesh, line: str) -> None:
    """Make the mesh, write it and what was asked for beside it, and show it in numbers."""
    options, places = read_options(command), places_of(command.out)
    refuse(places, _named(command), command.overwrite)
    with console.Progress(unit="") as progress:
        progress.begin(STEPS[0], len(STEPS))
        measured = read_clouds(command.clouds, command.poses)
        refuse(places, measured.files, command.overwrite)
        reference = None if command.reference is None else load_mesh(command.reference)
        progress.advance(1)
        progress.describe(STEPS[1])
        result = _measured_mesh(command, options, measured, reference, progress)
        progress.describe(STEPS[3])
        contents = _contents(command, result, places, line)
        write_all(contents, [place for place in places if place not in contents])
    for table in tables(result):
        console.write_table(*table)
    for note in result.measured.notes:
        console.write(f"note: {note}")
    console.write(f"wrote {', '.join(str(place) for place in contents)}: {outcome(result)}")
    if command.json:
        about = {"status": "ok", "out": str(places.mesh), "files": [str(place) for place in contents]}
        console.write(json_text({**about, **quality_tree(result, line)}, indent=None))


def _named(command: Mesh) -> list[Path]:
    return [*command.clouds, *(path for path in (command.poses, command.reference) if path is not None)]


def _measured_mesh(
    command: Mesh, options: Options, measured: Measured, reference: ObjectMesh | None, progress: console.Progress
) -> Result:
    started = time.perf_counter()
    made = make_mesh(measured, options)
    seconds = {"mesh": time.perf_counter() - started}
    segments = None
    if command.segment:
        from jaxmodel.mesh.segmentation import segment

        started = time.perf_counter()
        segments = segment(made.mesh, snapping=command.snap)
        made = made._replace(mesh=segments.mesh)
        seconds["segment"] = time.perf_counter() - started
    progress.advance(1)
    progress.describe(STEPS[2])
    result = Result(
        measured=measured,
        options=options,
        made=made,
        quality=quality(made.mesh),
        segments=segments,
        reference=command.reference,
        distance=None if reference is None else surface_distance(made.mesh, reference),
        seconds=seconds,
    )
    progress.advance(1)
    return result


def _contents(command: Mesh, result: Result, places: Places, line: str) -> dict[Path, bytes]:
    """The files to write, the mesh last: where it is, the others are."""
    contents = {places.quality: json_text(quality_tree(result, line)).encode()}
    if result.segments is not None:
        contents[places.segments] = json_text(segments_tree(result.segments, command.snap), indent=None).encode()
    if command.report:
        from jaxmodel.run.meshing.report import report_page

        contents[places.report] = report_page(result, places.mesh.name, line).encode()
    colours = None if result.segments is None else face_colours(result.segments)
    suffix = places.mesh.suffix.lower()
    contents[places.mesh] = mesh_bytes(result.made.mesh, suffix, result.made.normals, colours)
    return contents
