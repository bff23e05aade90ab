"""What an exploration leaves to be drawn: the plan with the sensor's way, the data by view, the map at the end."""

import numpy as np

from jaxmodel.io.results import RunDir
from jaxmodel.plan.explore import Step
from jaxmodel.plan.labels import Label
from jaxmodel.run.meshing.colours import number_colours
from jaxmodel.run.meshing.drawing_data import Drawn, keep
from jaxmodel.run.planning.environment_scene import EnvironmentScene
from jaxmodel.run.planning.pictures import voxel_mesh, with_sensors

EARLY = 6
"""Views whose data are drawn by colour (Fig. 4.8)."""
NO_FACES = np.zeros((0, 3), np.int64)


def keep_environment(folder: RunDir, name: str, scene: EnvironmentScene, steps: list[Step]) -> None:
    """Keep the surface with the sensors, the readings of the first views in their colours, the last map, cut open."""
    vertices = np.asarray(scene.environment.mesh.vertices, np.float64)
    faces = np.asarray(scene.environment.mesh.faces, np.int64)
    size = float(np.ptp(vertices, axis=0).max())
    poses = np.stack([step.T_world_sensor for step in steps])
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    # the cube without its ceiling; of the rooms, whose ceilings differ, the floor as a plan (Fig. 4.10)
    lidded = high - 0.02 * (high - low) if scene.name == "cube" else low + 0.02 * (high - low)
    floor = faces[vertices[faces][:, :, 2].max(axis=1) < lidded]
    grey = np.full((len(floor), 3), 215, np.uint8)
    points, colours = [], []
    for number, step in enumerate(steps[:EARLY]):
        R, t = step.placed.T_world_sensor[:3, :3], step.placed.T_world_sensor[:3, 3]
        read = step.image.points[step.image.valid][::7] @ R.T + t
        points.append(read)
        colours.append(np.repeat(number_colours(np.array([number])), len(read), axis=0))
    keep(
        folder,
        name,
        views=with_sensors(Drawn(vertices, floor, grey), poses, size / 25),
        data=Drawn(np.concatenate(points), NO_FACES, np.concatenate(colours)),
        map=_cut(voxel_mesh(steps[-1].map, (Label.OCCUPIED, Label.BORDER, Label.OCCLUSION_PLANE)), low, high),
    )


def _cut(drawn: Drawn, low: float, high: float) -> Drawn:
    """Without the ceiling, so that one looks in."""
    below = drawn.vertices[drawn.faces][:, :, 2].mean(axis=1) < low + 0.6 * (high - low)
    return Drawn(drawn.vertices, drawn.faces[below], drawn.colours[below])
