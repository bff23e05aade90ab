"""Meshes from points: ball pivoting, segmentation, growth by views, and the rivals."""

from jaxmodel.mesh.segmentation import Outcome, Primitive, Segmentation, segment

__all__ = ["Outcome", "Primitive", "Segmentation", "segment"]
