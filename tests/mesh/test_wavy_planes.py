"""Planes with long low waves are planes, shallow domes and high waves are none."""

import numpy as np
import pytest

from jaxmodel.mesh import segment
from jaxmodel.scan.triangle_mesh import ObjectMesh

CELLS = 40


def sheet(height: np.ndarray) -> ObjectMesh:
    """A square grid of edges of length 1 with a height at each vertex."""
    i, j = np.meshgrid(np.arange(CELLS), np.arange(CELLS), indexing="ij")
    a = (i * (CELLS + 1) + j).reshape(-1)
    b = a + CELLS + 1
    faces = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    x, y = (part.reshape(-1) for part in np.meshgrid(*[np.arange(CELLS + 1.0)] * 2, indexing="ij"))
    return ObjectMesh(np.stack([x, y, height.reshape(-1)], axis=1), faces)


def waves() -> np.ndarray:
    """Waves of rms height 1, three across the sheet."""
    phase = 6 * np.pi * np.arange(CELLS + 1) / CELLS
    return 2 * np.sin(phase)[:, None] * np.cos(phase)[None, :] / np.sqrt(1.05)


def dome() -> np.ndarray:
    """A paraboloid of rms height 1 over its mean."""
    across = np.linspace(-1, 1, CELLS + 1) ** 2
    bowl = across[:, None] + across[None, :]
    return (bowl - bowl.mean()) / bowl.std()


@pytest.mark.parametrize(("shape", "rms", "kind"), [(waves, 0.03, "plane"), (waves, 0.3, "free-form")])
def test_low_waves_are_a_plane(shape, rms: float, kind: str) -> None:
    found = segment(sheet(rms * shape()))
    assert found.noise < 0.2 * rms
    area = sum(one.area for one in found.primitives)
    assert found.primitives[0].kind == kind and found.primitives[0].area > 0.9 * area
    if kind == "plane":
        assert len(found.primitives) == 1 and found.primitives[0].rms == pytest.approx(rms, rel=0.1)
        assert abs(found.primitives[0].direction[2]) == pytest.approx(1, abs=1e-3)


def test_a_shallow_dome_is_no_plane() -> None:
    found = segment(sheet(0.04 * dome()))
    area = sum(one.area for one in found.primitives)
    assert sum(one.area for one in found.primitives if one.kind == "plane") < 0.05 * area
