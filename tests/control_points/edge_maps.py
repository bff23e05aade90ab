"""Range images made by hand or scanned, and edge maps made by hand, for the tests of contours."""

import jax
import numpy as np

from jaxmodel.control_points.contour_set import ContourSet
from jaxmodel.control_points.edges import EdgeKind, EdgeMap
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import scan_mesh, turntable_poses

ABOVE = np.array([0.0, 0.0, 1.0, 0.0])


def height_field(z: np.ndarray, scale: float = 1.0) -> RangeImage:
    """An orthographic image seen from above with pixel spacing ``scale``; NaN heights are missing readings."""
    row, column = np.indices(z.shape).astype(float)
    valid = np.isfinite(z)
    points = scale * np.where(valid[..., None], np.stack([column, -row, z], axis=-1), np.nan)
    return RangeImage(points=points, valid=valid, eye=ABOVE)


def edge_map(kind: np.ndarray, far: np.ndarray | None = None, valid: np.ndarray | None = None) -> EdgeMap:
    """A map with these labels; ``far`` where it is DEPTH alone."""
    shape = kind.shape
    return EdgeMap(
        kind=kind.astype(np.int8),
        far=np.zeros(shape, dtype=bool) if far is None else far & (kind == EdgeKind.DEPTH),
        orientation=np.zeros(shape, dtype=np.int8),
        angle_deg=np.full(shape, np.nan),
        valid=np.ones(shape, dtype=bool) if valid is None else valid,
        noise=0.0,
    )


def digital_line(shape: tuple[int, int], start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    """Row and column of the pixels nearest to a segment, one for each step of its longer side, in order."""
    ends = np.array([start, end], dtype=float)
    steps = int(np.ceil(np.abs(ends[1] - ends[0]).max()))
    pixels = np.rint(ends[0] + np.linspace(0, 1, steps + 1)[:, None] * (ends[1] - ends[0])).astype(int)
    assert (pixels >= 0).all() and (pixels < shape).all()
    return pixels


def all_pixels(contours: ContourSet) -> np.ndarray:
    """Row and column of every pixel of the chains, once, row-major."""
    chains = [chain.pixels for chain in contours.chains]
    return np.unique(np.concatenate(chains), axis=0) if chains else np.zeros((0, 2), dtype=int)


def scanned(name: str, angle_deg: float = 30.0, noise: float = 0.0, width: int = 200) -> RangeImage:
    """A view of a built-in object against nothing."""
    mesh, (T,) = object_mesh(name), turntable_poses([angle_deg], 3.0, 25.0)
    sensor = Sensor(width=width, height=width)
    return scan_mesh(mesh.vertices, mesh.faces, sensor, T, Laser(sigma=noise), jax.random.key(1))


def steps_image() -> RangeImage:
    """A roof and a block on a floor, seen from above: creases, jumps and borders, and a hole."""
    row, column = np.indices((70, 90))
    z = np.where(column < 45, -0.6 * np.abs(column - 22.0), -13.8)
    z = np.where((row > 20) & (row < 50) & (column > 55) & (column < 80), 15.0, z)
    z[60:64, 30:36] = np.nan
    return height_field(z)
