"""Meshes from points: ball pivoting, segmentation, growth by views, and the rivals."""
