"""Meshes from points: ball pivoting, segmentation, growth by views, and the rivals."""

from jaxmodel.mesh.ball_pivoting import Pivoting, ball_pivot, ball_pivoting
from jaxmodel.mesh.quality import Quality, quality
from jaxmodel.mesh.segmentation import Outcome, Primitive, Segmentation, segment

__all__ = [
    "Outcome", "Pivoting", "Primitive", "Quality", "Segmentation", "ball_pivot", "ball_pivoting", "quality", "segment",
]  # fmt: skip
