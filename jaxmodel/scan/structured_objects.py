"""Structured test objects: planes, cylinders and sharp edges, as on machined parts (thesis §2.9, structured set).

Each is a union of closed parts that overlap (see :class:`ObjectMesh`), centred, its longest side 1, and without
any rotation that maps it to itself, so that a registration has one answer.
"""

import numpy as np

from jaxmodel.scan.triangle_mesh import ObjectMesh, Place, box, join, lathe, placed, ring, unit_sized


def block_steps() -> ObjectMesh:
    """A block with steps of different heights and widths along both sides."""
    return unit_sized(
        join(
            box((0.00, 0.00, 0.0), (1.00, 0.70, 0.20)),
            box((0.00, 0.00, 0.0), (0.68, 0.70, 0.34)),
            box((0.00, 0.00, 0.0), (0.40, 0.48, 0.50)),
            box((0.00, 0.00, 0.0), (0.22, 0.26, 0.62)),
            box((0.80, 0.45, 0.0), (0.92, 0.62, 0.42)),
        )
    )


def block_curved(cells: int = 40) -> ObjectMesh:
    """A block with a convex, a concave and a wavy face, its edges kept sharp; one closed surface."""
    mesh = box((-0.5, -0.35, -0.25), (0.5, 0.35, 0.25), cells)
    x, y, z = mesh.vertices.T
    # Each shift grows from 0 on one face to its full height on the opposite one, so the faces stay apart.
    bulge = 0.16 * (x + 0.5) * (1 - (y / 0.35) ** 2)
    hollow = -0.22 * (y + 0.35) * (1 - ((x - 0.08) / 0.58) ** 2)
    wave = 0.22 * (z + 0.25) * np.sin(2.2 * np.pi * (x + 0.6 * y + 0.1))
    return unit_sized(ObjectMesh(vertices=np.stack([x + bulge, y + hollow, z + wave], axis=1), faces=mesh.faces))


def y_pipe() -> ObjectMesh:
    """A pipe branching in two, its three arms of different length, width and angle, each with flange and bore."""
    return unit_sized(
        join(
            _arm((0.0, 0.0, -1.0), length=0.55, radius=0.120, flange=0.19),
            _arm((0.65, 0.0, 0.75), length=0.60, radius=0.095, flange=0.15),
            _arm((-0.80, 0.15, 0.55), length=0.42, radius=0.105, flange=0.17),
            _ball(0.145),
            placed(lathe([(0, 0), (0.05, 0), (0.05, 0.22), (0, 0.22)], 24), (0.2, 1.0, -0.1), (0.0, 0.0, -0.05)),
        )
    )


def valve() -> ObjectMesh:
    """A valve: round body, two unequal flanges, a bonnet and a hand wheel with three spokes."""
    wheel_height = 0.50
    parts = [
        _arm((1.0, 0.0, 0.0), length=0.50, radius=0.105, flange=0.20),
        _arm((-1.0, 0.0, 0.0), length=0.36, radius=0.125, flange=0.17),
        _ball(0.20),
        lathe([(0, 0), (0.11, 0), (0.11, 0.30), (0.075, 0.34), (0.04, 0.34), (0.04, 0.54), (0, 0.54)]),
        placed(ring(0.24, 0.03), (0, 0, 1), (0, 0, wheel_height)),
        placed(lathe([(0, 0), (0.06, 0), (0.06, 0.24), (0, 0.24)], 24), (0.35, 1.0, -0.2), (0.0, 0.0, 0.0)),
    ]
    for degrees in (20.0, 140.0, 260.0):
        angle = np.deg2rad(degrees)
        spoke = lathe([(0, 0), (0.022, 0), (0.022, 0.24), (0, 0.24)], 16)
        parts.append(placed(spoke, (float(np.cos(angle)), float(np.sin(angle)), 0.0), (0.0, 0.0, wheel_height)))
    return unit_sized(join(*parts))


def _arm(direction: Place, length: float, radius: float, flange: float) -> ObjectMesh:
    """A pipe from the origin with a flange and a blind bore at its far end."""
    bore, rim, depth = 0.65 * radius, 0.07, 0.15
    profile = [
        (0.0, 0.0),
        (radius, 0.0),
        (radius, length - rim),
        (flange, length - rim),
        (flange, length),
        (bore, length),
        (bore, length - depth),
        (0.0, length - depth),
    ]
    return placed(lathe(profile), direction, (0.0, 0.0, 0.0))


def _ball(radius: float) -> ObjectMesh:
    """A sphere as a lathe solid."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 25)
    profile = [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angle[1:-1]]
    return lathe([(0.0, -radius), *profile, (0.0, radius)])
