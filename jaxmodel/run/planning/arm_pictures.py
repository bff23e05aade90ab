"""The arm as sticks before the object, at each view that was taken (Figs 4.12, 4.13)."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from jaxmodel.io.results import RunDir
from jaxmodel.plan.arm import Arm
from jaxmodel.plan.arm_lines import chain_points
from jaxmodel.plan.coverage import visible
from jaxmodel.run.meshing.colours import number_colours
from jaxmodel.run.meshing.drawing_data import Drawn, keep
from jaxmodel.run.planning.arm_run import ArmStep
from jaxmodel.run.planning.arm_scene import ArmScene
from jaxmodel.run.planning.pictures import first_seen, voxel_mesh, with_sensors

SIDES = 6
THICK = 0.02
"""Radius of a stick, in the arm's size."""
MOST_ARMS = 6
"""Postures drawn in one picture."""


def joined(*parts: Drawn) -> Drawn:
    """Meshes as one."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Drawn(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, first, strict=True)]),
        np.concatenate([part.colours for part in parts]),
    )


def sticks(points: Float[np.ndarray, "n 3"], radius: float, colour: np.ndarray) -> Drawn:
    """A tube along each link between ``points``; links without length are left out."""
    vertices, faces = [], []
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    for one, two in pairwise(points):
        along = two - one
        if np.linalg.norm(along) <= 1e-9:
            continue
        along = along / np.linalg.norm(along)
        across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        across /= np.linalg.norm(across)
        ring = radius * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(along, across))
        start, k = 2 * SIDES * len(vertices), np.arange(SIDES)
        following = (k + 1) % SIDES
        low, high = start + k, start + SIDES + k
        vertices.append(np.concatenate([one + ring, two + ring]))
        faces += [
            np.stack([low, start + following, high], axis=1),
            np.stack([high, start + following, start + SIDES + following], axis=1),
        ]
    if not vertices:
        return Drawn(np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3), np.uint8))
    triangles = np.concatenate(faces)
    return Drawn(np.concatenate(vertices), triangles, np.tile(colour, (len(triangles), 1)))


def arm_sticks(arm: Arm, joints: Float[np.ndarray, " n"], colour: np.ndarray) -> Drawn:
    """The arm at ``joints``."""
    return sticks(chain_points(arm, joints), THICK * arm.size / 2, colour)


def keep_arm_run(folder: RunDir, name: str, scene: ArmScene, steps: list[ArmStep]) -> None:
    """Keep the object by view with the sensors, the arm at some views, and the map at the end."""
    of = scene.object
    poses = np.stack([one.step.T_world_sensor for one in steps])
    seen = visible(of.samples, of.mesh, poses, of.sensor)
    surface = first_seen(np.asarray(of.mesh.vertices, np.float64), np.asarray(of.mesh.faces), of.samples, seen)
    views = with_sensors(surface, poses, of.size / 8)
    drawn = [(number, one) for number, one in enumerate(steps) if one.views is not None]
    some = [drawn[k] for k in np.unique(np.linspace(0, len(drawn) - 1, MOST_ARMS).round().astype(int))] if drawn else []
    arms = [
        arm_sticks(one.arm, np.asarray(one.views.placements.joints[0]), number_colours(np.array([number]))[0])
        for number, one in some
        if one.views is not None
    ]
    keep(folder, name, views=views, arms=joined(views, *arms), map=voxel_mesh(steps[-1].step.map))
