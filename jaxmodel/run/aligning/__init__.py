"""Whole sets of scans in one frame as an experiment, and the command ``jaxmodel align``."""
