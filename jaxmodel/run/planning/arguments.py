"""The words of ``jaxmodel plan`` as a type, like the other commands in ``run/arguments.py``.

Nothing heavy is imported here, so ``--help`` answers at once.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

_Positional = tyro.conf.Positional


@dataclass(frozen=True)
class Plan:
    """Model an object view by view with the virtual scanner, each next view planned; how much is seen after each.

    The sensor moves on an observation sphere around the object and looks at its middle. Coverage is the share of the
    surface, of what at least one pose of the sphere sees. The run ends when nothing new is in reach, when two views in
    a row add almost nothing, or when the views are used up.

    Examples:
      jaxmodel plan part.stl --views 12 --out runs/part
      jaxmodel plan part.stl --arm robot.urdf --mount runs/hand_eye/calibration.json --out runs/part_on_the_arm
    """

    mesh: _Positional[str]
    """The object: a mesh (ply, obj, stl), or a built-in one (gourd, valve, y_pipe, block_curved, stepped_block)."""
    out: Path | None = None
    """Folder for the results, not yet existing. Required unless --resume is given."""
    views: int = 20
    """How many views at most."""
    planner: Literal["utility", "area_factor", "uniform", "random"] = "utility"
    """utility: the thesis's, made to last to the end; the others are what it is measured against."""
    cells: int = 64
    """Voxels of the map along an edge."""
    distance: float = 1.6
    """Radius of the observation sphere, in diameters of the object."""
    lowest: float = -90.0
    """Lowest elevation of a view, degrees: 0 for an object on a table."""
    pixels: int = 200
    """Pixels of the range image across and up."""
    field_of_view: float = 40.0
    """Of the sensor, degrees."""
    noise: float = 0.0
    """Standard deviation of a reading, in the object's longest side."""
    overlap: float = 0.3
    """Least share of a view's readings that must fall on what is known, so that it can be registered."""
    register: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Place each view by registration to those before it, from 2 degrees and 1 % of the size off."""
    arm: str | None = None
    """Put the sensor on an arm: gt6a_like, or a URDF file. Only views in reach are taken, the base moves around the
    object where the rest is out of reach, and poses.json also holds the joints. The object is then as large as
    --object-size, and lies on a table: no view from below."""
    mount: str | None = None
    """File with T_hand_camera, as calibration.json of jaxmodel calibrate; with --arm."""
    object_size: float = 0.2
    """Diameter of the ball the object lies in, metres; with --arm."""
    base_distance: float = 0.6
    """Of the arm's foot from the object's vertical, metres; with --arm."""
    base_below: float = 0.3
    """Height of the object's middle above the arm's foot, metres; with --arm."""
    seed: int = 0
    """Of every random draw."""
    resume: Path | None = None
    """Folder of an interrupted run to continue."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""
