"""What a run leaves to be drawn: the object coloured by the view that first saw it, the map, and where views stood."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxmodel.io.results import RunDir
from jaxmodel.plan.coverage import visible
from jaxmodel.plan.explore import Step
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.labels import Label
from jaxmodel.plan.surface_samples import SurfaceSamples
from jaxmodel.run.meshing.colours import number_colours
from jaxmodel.run.meshing.drawing_data import Drawn, keep
from jaxmodel.run.planning.object_scene import ObjectScene

GREY = (205, 205, 205)
LABEL_COLOURS = {Label.OCCUPIED: (40, 70, 160), Label.BORDER: (225, 140, 40), Label.OCCLUSION_PLANE: (130, 195, 235)}
"""As in Fig. 4.11: occupied dark blue, occlusion planes light blue."""
_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
_SIDES = {
    (0, -1): (0, 4, 7, 3), (0, 1): (1, 2, 6, 5), (1, -1): (0, 1, 5, 4), (1, 1): (3, 7, 6, 2), (2, -1): (0, 3, 2, 1),
    (2, 1): (4, 5, 6, 7),
}  # fmt: skip


def voxel_mesh(map: LabelMap, labels: tuple[Label, ...] = tuple(LABEL_COLOURS)) -> Drawn:
    """The sides of voxels of ``labels`` that border others, each voxel in its label's colour."""
    of = map.labels
    shown = np.isin(of, [int(label) for label in labels])
    corners, colours = [], []
    for (axis, direction), side in _SIDES.items():
        moved = np.zeros_like(shown)
        here, there = [slice(None)] * 3, [slice(None)] * 3
        later, earlier = slice(1, None), slice(None, -1)
        here[axis], there[axis] = (later, earlier) if direction < 0 else (earlier, later)
        moved[tuple(here)] = shown[tuple(there)]
        index = np.argwhere(shown & ~moved)
        corners.append(index[:, None] + _CORNERS[list(side)])
        table = np.zeros((len(Label), 3), np.uint8)
        for label, colour in LABEL_COLOURS.items():
            table[label] = colour
        colours.append(table[of[tuple(index.T)]])
    quads = np.concatenate(corners).reshape(-1, 3) * map.grid.cell + map.grid.origin
    first = 4 * np.arange(len(quads) // 4)[:, None]
    faces = np.stack([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])], axis=1).reshape(-1, 3)
    return Drawn(quads, faces, np.repeat(np.concatenate(colours), 2, axis=0))


def first_seen(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    samples: SurfaceSamples,
    seen: Bool[np.ndarray, "v s"],
) -> Drawn:
    """The object, each triangle in the colour of the view (row of ``seen``) that first saw it, else grey."""
    first = np.where(seen.any(axis=0), seen.argmax(axis=0), len(seen))
    of_face = np.full(len(faces), len(seen))
    np.minimum.at(of_face, samples.faces, first)
    # a small triangle may hold no sample: the nearest sample speaks for it
    bare = np.setdiff1d(np.arange(len(faces)), samples.faces)
    if len(bare):
        of_face[bare] = first[KDTree(samples.points).query(vertices[faces[bare]].mean(axis=1))[1]]
    colours = np.concatenate([number_colours(np.arange(len(seen))), np.array([GREY], np.uint8)])
    return Drawn(vertices, faces, colours[of_face])


def with_sensors(drawn: Drawn, poses: Float[np.ndarray, "v 4 4"], size: float) -> Drawn:
    """The mesh with a small pyramid at each pose, its tip where the sensor stands, in the colour of its view."""
    base = np.array([[0, 0, 0], [-0.5, -0.5, 1], [0.5, -0.5, 1], [0.5, 0.5, 1], [-0.5, 0.5, 1]]) * size
    sides = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]])
    corners = np.einsum("vab,cb->vca", poses[:, :3, :3], base) + poses[:, None, :3, 3]
    pyramids = (5 * np.arange(len(poses))[:, None, None] + sides).reshape(-1, 3)
    colours = np.repeat(number_colours(np.arange(len(poses))), len(sides), axis=0)
    return Drawn(
        np.concatenate([drawn.vertices, corners.reshape(-1, 3)]),
        np.concatenate([drawn.faces, pyramids + len(drawn.vertices)]),
        np.concatenate([drawn.colours, colours]),
    )


def keep_run(folder: RunDir, name: str, scene: ObjectScene, steps: list[Step]) -> None:
    """Keep what a run's pictures need: the object by view, with the sensors, and the map at the end."""
    poses = np.stack([step.T_world_sensor for step in steps])
    seen = visible(scene.samples, scene.mesh, poses, scene.sensor)
    vertices, faces = np.asarray(scene.mesh.vertices, np.float64), np.asarray(scene.mesh.faces, np.int64)
    surface = first_seen(vertices, faces, scene.samples, seen)
    views, voxels = with_sensors(surface, poses, scene.size / 8), voxel_mesh(steps[-1].map)
    keep(folder, name, surface=surface, views=views, map=voxels)
