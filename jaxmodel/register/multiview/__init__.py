"""Whole sets of views in one frame: which pairs belong together, the thesis's orders of fusion, and all at once."""
