"""Meshes from points: ball pivoting, segmentation, growth by views, and the rivals."""

from jaxmodel.mesh.ball_pivoting import Pivoting, ball_pivot, ball_pivoting
from jaxmodel.mesh.quality import Quality, quality

__all__ = ["Pivoting", "Quality", "ball_pivot", "ball_pivoting", "quality"]
