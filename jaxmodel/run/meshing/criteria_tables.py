"""The criteria of quality by themselves: on known shapes (Figs 3.13, 3.14), on a part of an object (Fig. 3.15)."""

import numpy as np

from jaxmodel.mesh.quality import smoothness, triangle_shape
from jaxmodel.run.meshing.synthetic_part import OBJECT, synthetic_part
from jaxmodel.run.published import published_table
from jaxmodel.scan.triangle_mesh import icosphere
from jaxmodel.view.table import Table

SPHERES = (0, 1, 2, 3, 4)


def known_shapes() -> Table:
    right = published_table("mesh_quality")["right_isosceles_Q_equ"]
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, np.sqrt(0.75), 0]])
    face = {"right isosceles triangle": (f"{right}", [0, 1, 2]), "equilateral triangle": ("1", [0, 1, 3])}
    rows = [
        (f"Q_equ, {name}", printed, f"{triangle_shape(corners, np.array([of]))[0]:.4f}")
        for name, (printed, of) in face.items()
    ]
    for subdivisions in SPHERES:
        ball = icosphere(subdivisions)
        smooth = smoothness(ball.vertices, ball.faces).mean()
        rows.append((f"Q_nor, sphere of {len(ball.faces)} triangles", "rises with them", f"{smooth:.4f}"))
    return Table("The criteria on known shapes (Figs 3.13, 3.14)", ("what", "published", "ours"), rows)


def synthetic_part_table() -> Table:
    """Fig. 3.15, *published | ours*, and which of both meshes is better."""
    published, ours = published_table("mesh_quality")["synthetic_part"], synthetic_part()
    rows = []
    for method, label in (("ball", "ball pivoting"), ("deformable", "deformable surface")):
        said, found = published[method], ours[method]
        counts = ((said["vertices"], found.vertices - found.unused_vertices), (said["triangles"], found.triangles))
        values = ((said[key], getattr(found, key)) for key in ("Q_equ", "Q_nor"))
        cells = *(f"{a} | {b}" for a, b in counts), *(f"{a:.4f} | {b:.4f}" for a, b in values)
        rows.append((label, *cells))
    better = ["better: the deformable surface", "", ""]
    for key in ("Q_equ", "Q_nor"):
        holds = getattr(ours["deformable"], key) > getattr(ours["ball"], key)
        better.append("reproduced" if holds else "contradicted")
    columns = ("method", "vertices", "triangles", "Q_equ", "Q_nor")
    title = f"A part of a synthetic object (Fig. 3.15), published | ours (the {OBJECT}, without noise)"
    return Table(title, columns, [*rows, tuple(better)])
