"""Range images whose surfaces are known, for the tests of split meshes."""

import jax
import numpy as np
from edge_maps import height_field
from jaxtyping import Float

from jaxmodel.scan.noise import Noise
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import scan_mesh, turntable_poses


def waves(scale: float = 1.0) -> RangeImage:
    """Waves on the right, a plane on the left with a round hole of radius 6 at row 20, column 15."""
    y, x = np.indices((50, 60)).astype(float)
    z = 2.0 * np.clip((x - 30) / 8, 0.0, 1.0) * np.sin(x / 3.0) * np.cos(y / 4.0)
    z[(x - 15) ** 2 + (y - 20) ** 2 <= 36] = np.nan
    return height_field(z, scale)


def terrace_heights() -> Float[np.ndarray, "60 80"]:
    """A block 25 units high, rows 15 to 44 and columns 20 to 59, on a plane."""
    y, x = np.indices((60, 80))
    return 25.0 * ((y >= 15) & (y < 45) & (x >= 20) & (x < 60))


def roof_heights(angle_deg: float = 30.0) -> Float[np.ndarray, "60 80"]:
    """Two planes that meet at column 40, each sloping by ``angle_deg``."""
    _, x = np.indices((60, 80)).astype(float)
    return -np.tan(np.deg2rad(angle_deg)) * np.abs(x - 40)


def scanned(name: str, size: int = 200, noise: Noise | None = None) -> RangeImage:
    """A test object as a pinhole sensor sees it from above, 30 degrees round."""
    mesh = object_mesh(name)
    pose = turntable_poses([30.0], 3.0, 35.0)[0]
    return scan_mesh(mesh.vertices, mesh.faces, Sensor(size, size), pose, noise, jax.random.key(0) if noise else None)


def transposed(image: RangeImage) -> RangeImage:
    """Rows and columns swapped; the points stay."""
    return RangeImage(points=np.swapaxes(image.points, 0, 1), valid=image.valid.T, eye=image.eye)
