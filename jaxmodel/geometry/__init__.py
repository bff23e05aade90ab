"""Shared pure mathematics: rigid motions and fits, voxel grids, closest points, masked statistics."""

from jaxmodel.geometry.rigid_fit import FitOutcome, RigidFit, fit_rigid, rigid_fit

__all__ = ["FitOutcome", "RigidFit", "fit_rigid", "rigid_fit"]
