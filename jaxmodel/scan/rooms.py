"""Environments seen from inside: a cube, and two rooms joined by a passage (thesis figs 4.5 and 4.10).

Each mesh is the single-sided inner surface of the walls, closed without a gap, every triangle counter-clockwise seen
from the free space. Walls have no thickness: nothing is known of what lies behind them, and a sensor stands inside.
"""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.scan.room_plan import Plan, drawn_up
from jaxmodel.scan.triangle_mesh import Number, ObjectMesh, Place, box
from jaxmodel.scan.virtual_scanner import look_at


class Environment(eqx.Module):
    """An environment in its world frame, z up: its surface, its free space, and where the sensor starts.

    ``T_world_start (4, 4)`` is the sensor's first pose (x right, y down, z forward). ``inside`` tells by formula, not
    by the mesh, which points ``(n, 3)`` lie in the free space; round parts of the mesh are polygons inside or outside
    the true curves, so the two differ within a polygon's sagitta of a column or the dome.
    """

    mesh: ObjectMesh
    T_world_start: Float[np.ndarray, "4 4"]
    inside: Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]]


def cube_room(edge: Number = 1, sensor_at: Place = (0, 0, 0)) -> Environment:
    """The inside of a cube of given ``edge`` centred on the origin, seen from a fixed point (thesis figs 4.5 to 4.8).

    The sensor stands at ``sensor_at``, in edges from the centre, and starts looking along +x; it turns by pan and
    tilt only. The thesis draws the cube and the sensor's place without numbers: the centre is our choice.
    Raises :class:`InputError` for an edge that is not positive or a sensor outside.
    """
    if not edge > 0:
        raise InputError(f"edge: expected a positive length, got {edge}.")
    half = edge / 2
    eye = edge * np.array(sensor_at, dtype=np.float64)
    if not np.abs(eye).max() < half:
        raise InputError(f"sensor_at: expected a place inside the cube, each coordinate within 0.5, got {sensor_at}.")
    outer = box((-half, -half, -half), (half, half, half))
    return Environment(
        mesh=ObjectMesh(outer.vertices, outer.faces[:, ::-1]),
        T_world_start=look_at(eye, eye + np.array([1.0, 0.0, 0.0])),
        inside=lambda points: np.abs(points).max(axis=1) < half,
    )


@dataclass(frozen=True)
class TwoRooms:
    """Measures of the two rooms, in metres. The thesis draws the plan (fig. 4.10) without any: these are ours.

    The rooms lie along x, both ``width`` wide in y and ``height`` high; the passage, of full height, lies around the
    origin of the floor. The dome rises ``dome_rise`` over the ceiling of the left room, round its middle; the columns,
    from floor to ceiling, stand ``column_offset`` from that middle in x and in y. Raises :class:`InputError` for
    measures that do not fit together.
    """

    left_length: float = 6.0
    right_length: float = 4.5
    passage_length: float = 1.5
    passage_width: float = 1.2
    width: float = 6.0
    height: float = 3.0
    dome_radius: float = 2.0
    dome_rise: float = 1.0
    column_radius: float = 0.25
    column_offset: float = 2.1
    sensor_height: float = 1.5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"two rooms, {name}: expected a positive length, got {value}.")
        half = min(self.left_length, self.width) / 2
        fits = {
            "the passage must be narrower than the rooms": self.passage_width < self.width,
            "the dome must fit over the left room": self.dome_radius < half,
            "the dome must not be more than a half sphere": self.dome_rise <= self.dome_radius,
            "the columns must stand clear of the walls": self.column_offset + self.column_radius < half,
            "the columns must stand clear of the dome": np.sqrt(2) * self.column_offset
            > self.dome_radius + self.column_radius,
            "the sensor must be below the ceiling": self.sensor_height < self.height,
        }
        for law, holds in fits.items():
            if not holds:
                raise InputError(f"two rooms: {law}.")

    @property
    def ends(self) -> Float[np.ndarray, "4"]:
        """x of the left end, of the passage's left and right end, and of the right end."""
        half = self.passage_length / 2
        return np.array([-half - self.left_length, -half, half, half + self.right_length])

    @property
    def dome_centre(self) -> tuple[float, float]:
        """Middle of the left room, (x, y)."""
        return float(self.ends[0] + self.ends[1]) / 2, 0.0

    @property
    def dome_sphere_radius(self) -> float:
        """Radius of the sphere the dome is a cap of."""
        return (self.dome_radius**2 + self.dome_rise**2) / (2 * self.dome_rise)

    def inside(self, points_world: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which points lie in the free space, by formula."""
        x, y, z = points_world.T
        west, left, right, east = self.ends
        in_rooms = (x > west) & (x < east) & (np.abs(y) < self.width / 2)
        beside = (x >= left) & (x <= right) & (np.abs(y) >= self.passage_width / 2)
        free = in_rooms & ~beside & (z > 0) & (z < self.height)
        for column in self.columns():
            free &= np.hypot(x - column[0], y - column[1]) > self.column_radius
        from_axis = np.hypot(x - self.dome_centre[0], y)
        below = self.height - (self.dome_sphere_radius - self.dome_rise)
        dome = (z >= self.height) & (from_axis < self.dome_radius)
        return free | (dome & (np.hypot(from_axis, z - below) < self.dome_sphere_radius))

    def columns(self) -> list[tuple[float, float]]:
        """Axes of the four columns, (x, y)."""
        x, y = self.dome_centre
        d = self.column_offset
        return [(x - d, y - d), (x + d, y - d), (x + d, y + d), (x - d, y + d)]


def two_rooms(measures: TwoRooms | None = None, segments: int = 48, heading_deg: Number = 180) -> Environment:
    """Two rooms joined by a narrower passage; the left one has a dome and four columns (thesis fig. 4.10).

    ``segments`` is the number of sides of the dome's rim, columns have half as many. The sensor starts in the middle
    of the passage; ``heading_deg`` is its level direction around z, 0 along +x: towards the left room unless given
    (the arrow's direction in the thesis's figure is not said in its text). Raises :class:`InputError` for fewer than
    12 segments.
    """
    if segments < 12:
        raise InputError(f"segments: expected at least 12, got {segments}.")
    rooms = TwoRooms() if measures is None else measures
    west, left, right, east = rooms.ends
    far, near = rooms.width / 2, rooms.passage_width / 2
    outline = [(west, -far), (left, -far), (left, -near), (right, -near), (right, -far), (east, -far)]
    outline += [(x, -y) for x, y in reversed(outline)]
    plan = Plan(
        outline=np.array(outline),
        columns=[(column, rooms.column_radius, segments // 2) for column in rooms.columns()],
        dome=(rooms.dome_centre, rooms.dome_radius, segments),
    )
    angle = np.deg2rad(heading_deg)
    eye = np.array([0.0, 0.0, rooms.sensor_height])
    return Environment(
        mesh=drawn_up(plan, rooms.height, rooms.dome_rise),
        T_world_start=look_at(eye, eye + np.array([np.cos(angle), np.sin(angle), 0.0])),
        inside=rooms.inside,
    )
