"""Triangle meshes as the bytes of PLY, OBJ and STL files."""

import numpy as np
from jaxtyping import Float, UInt8

from jaxmodel.scan.triangle_mesh import ObjectMesh

WRITTEN_SUFFIXES = (".ply", ".obj", ".stl")


def mesh_bytes(
    mesh: ObjectMesh,
    suffix: str,
    normals: Float[np.ndarray, "n 3"],
    colours: UInt8[np.ndarray, "m 3"] | None = None,
) -> bytes:
    """The mesh as a file of one of ``WRITTEN_SUFFIXES``; ``normals`` of its vertices, ``colours`` of its triangles.

    PLY is binary, positions in float64. OBJ has no place for the colours, STL neither for them nor for shared vertices.
    """
    match suffix:
        case ".ply":
            return _ply(mesh, normals, colours)
        case ".obj":
            return _obj(mesh, normals)
        case ".stl":
            return _stl(mesh)
        case _:
            raise ValueError(suffix)


def _ply(mesh: ObjectMesh, normals: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "m 3"] | None) -> bytes:
    vertices = np.empty(len(mesh.vertices), [("place", "<f8", 3), ("normal", "<f4", 3)])
    vertices["place"], vertices["normal"] = mesh.vertices, normals
    fields: list = [("count", "u1"), ("corners", "<i4", 3)]
    faces = np.empty(len(mesh.faces), fields if colours is None else [*fields, ("colour", "u1", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    if colours is not None:
        faces["colour"] = colours
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property float n{axis}" for axis in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        *(f"property uchar {name}" for name in ("red", "green", "blue") if colours is not None),
        "end_header",
    ]
    return ("\n".join(header) + "\n").encode() + vertices.tobytes() + faces.tobytes()


def _obj(mesh: ObjectMesh, normals: Float[np.ndarray, "n 3"]) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(mesh.vertices, np.float64).tolist()]
    lines += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in normals.tolist()]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in (np.asarray(mesh.faces) + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


def _stl(mesh: ObjectMesh) -> bytes:
    corners = np.asarray(mesh.vertices, np.float64)[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    rows = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows["normal"], rows["corners"] = across / np.where(length > 0, length, 1.0), corners
    return b"binary STL".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()
