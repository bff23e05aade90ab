"""The words of ``jaxmodel mesh`` as a type, like the other commands in ``run/arguments.py``.

Nothing heavy is imported here, so ``--help`` answers at once.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

_Positional = tyro.conf.Positional


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh over a cloud of points, or over several clouds whose poses are known.

    Beside MESH.ply it writes MESH.quality.json (shape of the triangles, border, topology, what became of the points)
    and on request MESH.segments.json and MESH.report.html. Lengths have the unit of the data. Normals are taken from
    the file where it has them, and estimated where not.

    Example: jaxmodel mesh configs/meshing/example.xyz --segment --report --out part.ply
    Example: jaxmodel mesh --poses bun.conf --smallest-part 0.01 --out bunny.ply
    """

    clouds: Annotated[_Positional[tuple[Path, ...]], tyro.conf.arg(metavar="CLOUD...")] = ()
    """Points: ply, pcd, pts, xyz, obj, npz or a range image. Several need --poses; none: all that a .conf names."""
    out: Path | None = None
    """The mesh: .ply (binary, with normals and colours), .obj or .stl. Required."""
    poses: Path | None = None
    """Where each scan stood: a Stanford .conf, or JSON {scan name: T_world_scan, 4 x 4}."""
    method: Annotated[str, tyro.conf.arg(metavar="ball-pivoting|deformable|marching-cubes|poisson")] = "ball-pivoting"
    """ball-pivoting keeps measured points and leaves open what was not seen; deformable draws a closed sphere onto the
    cloud; marching-cubes and poisson go through a volume."""
    radii: Annotated[str | None, tyro.conf.arg(metavar="auto|R1,R2,...")] = None
    """Ball-pivoting: radii of the ball, pass by pass. Default auto: growing from the points' own spacing."""
    thinning: Annotated[str | None, tyro.conf.arg(metavar="auto|none|DISTANCE")] = None
    """Ball-pivoting: distance left between points. Default auto: only where layers of several scans overlap."""
    smallest_part: Annotated[float | None, tyro.conf.arg(metavar="SHARE")] = None
    """Components with a smaller share of the area are dropped (not for deformable, which is one). Default 0."""
    closing: Annotated[bool, tyro.conf.FlagCreatePairsOff] = True
    """Ball-pivoting: leave holes open along which points lie."""
    order: int | None = None
    """Deformable: order of the sphere. Default 5: 5120 triangles; 6: 20 480."""
    start: Literal["outside", "inside"] | None = None
    """Deformable: shrink from outside (default) or grow from inside."""
    cell: float | None = None
    """Marching cubes: edge of a voxel. Default: twice the points' spacing."""
    depth: int | None = None
    """Poisson: depth of the octree, 2 to 12. Default: its finest cell is about the points' spacing."""
    reference: Path | None = None
    """A mesh (ply, obj, stl) of the same object in the same frame: the distances both ways go into the quality."""
    segment: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Find planes, cylinders and spheres: MESH.segments.json, and each segment in its colour."""
    snap: bool = True
    """With --segment: move the vertices between primitives to where these meet."""
    report: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Write MESH.report.html: the mesh to turn, and its histograms; it works offline."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the files of an earlier mesh of this name."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""
