"""A camera as OpenCV describes it: pinhole, radial (rational) and tangential distortion.

Camera frame: x to the right, y down, z forward. Pixels are (column, row), integers at pixel centres.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError

TERMS = (0, 4, 5, 8)
ITERATIONS = 100
SETTLED, STRAY_RAY = 1e-12, 1e-6


@dataclass(frozen=True)
class Camera:
    """Intrinsic parameters.

    ``K (3, 3)``: focal lengths and principal point in pixels. ``distortion``: k1, k2, p1, p2, k3, k4, k5, k6 in
    OpenCV's order, kept as none, 4, 5 or 8 of them, zeros behind left out; OpenCV's thin-prism and tilt terms must
    be 0. ``width``, ``height``: size of the images that the parameters hold for. Raises :class:`InputError` for
    anything else.
    """

    K: Float[np.ndarray, "3 3"]
    distortion: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0))
    width: int = 640
    height: int = 480

    def __post_init__(self) -> None:
        K, distortion = np.asarray(self.K, np.float64), np.asarray(self.distortion, np.float64)
        if K.shape != (3, 3) or not np.isfinite(K).all():
            raise InputError(f"A camera matrix K must be 3 x 3 finite numbers, not {K.shape}.")
        if K[0, 0] <= 0 or K[1, 1] <= 0 or np.abs(K[[0, 1, 2, 2], [1, 0, 0, 1]]).max() > 0 or K[2, 2] != 1:
            raise InputError("A camera matrix K must be [fx 0 cx; 0 fy cy; 0 0 1] with fx, fy > 0, in pixels.")
        if distortion.ndim != 1 or not np.isfinite(distortion).all():
            raise InputError("A camera's distortion must be a list of finite numbers k1, k2, p1, p2, k3, ...")
        if distortion[8:].any():
            raise InputError("A camera's thin-prism and tilt distortion (beyond k6) is not supported; they must be 0.")
        last = int(np.flatnonzero(distortion).max(initial=-1)) + 1
        count = next(terms for terms in TERMS if terms >= last)
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "distortion", np.concatenate([distortion, np.zeros(8)])[:count])
        if self.width < 1 or self.height < 1:
            raise InputError(f"A camera's image size must be at least 1 x 1 pixel, not {self.width} x {self.height}.")

    def project(self, points_camera: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Pixels of points in the camera frame; NaN for those not in front of the camera."""
        depth = np.where(points_camera[:, 2:] > 0, points_camera[:, 2:], np.nan)
        x = points_camera[:, :2] / depth
        radial, tangential = self._distortion_at(x)
        return (x * radial + tangential) * np.diag(self.K)[:2] + self.K[:2, 2]

    def undistort(self, pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Image coordinates (x / z, y / z) of the ideal rays through pixels, by fixed-point iteration as in OpenCV.

        NaN where the iteration finds none: no ray arrives beyond the circle where a lens's distortion folds back.
        """
        seen = (pixels - self.K[:2, 2]) / np.diag(self.K)[:2]
        x = seen
        if not self.distortion.any():
            return x
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for _ in range(ITERATIONS):
                radial, tangential = self._distortion_at(x)
                before, x = x, (seen - tangential) / radial
                if np.nanmax(np.abs(x - before), initial=0.0) < SETTLED:
                    break
            radial, tangential = self._distortion_at(x)
            settled = np.abs(x * radial + tangential - seen).max(axis=1) < STRAY_RAY
        return np.where(settled[:, None], x, np.nan)

    def _distortion_at(self, x: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "n 1"], Float[np.ndarray, "n 2"]]:
        """Factor and shift that distort ideal image coordinates."""
        k1, k2, p1, p2, k3, k4, k5, k6 = np.concatenate([self.distortion, np.zeros(8)])[:8]
        s = np.sum(x * x, axis=1, keepdims=True)
        radial = (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))
        product = 2 * x[:, :1] * x[:, 1:]
        tangential = product * np.array([p1, p2]) + (s + 2 * x * x) * np.array([p2, p1])
        return radial, tangential
