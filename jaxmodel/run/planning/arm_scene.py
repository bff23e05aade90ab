"""An object within an arm's reach: where the arm stands, how it carries the sensor, where else its base may go."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.poses import load_transform
from jaxmodel.io.urdf import load_arm
from jaxmodel.plan.arm import Arm
from jaxmodel.plan.arm_models import gt6a_like
from jaxmodel.plan.arm_reposition import base_poses, bases_around
from jaxmodel.plan.inverse_kinematics import InverseKinematics
from jaxmodel.run.planning.object_scene import ObjectScene, SceneOptions, object_scene
from jaxmodel.run.planning.objects import load_object
from jaxmodel.scan.triangle_mesh import ObjectMesh

BUILT_IN = "gt6a_like"


@dataclass(frozen=True)
class ArmOptions:
    """The arm and how it stands before the object, in metres and degrees.

    ``arm``: ``gt6a_like``, or a URDF file, with ``base_link`` and ``flange_link`` where the file leaves them open.
    ``mount``: file with T_hand_camera, as ``calibration.json`` of ``jaxmodel calibrate``; None for a sensor that looks
    along the flange's z, ``ahead`` of it. ``size`` of the object: diameter of the ball it lies in. ``distance`` of the
    base from the object's vertical, ``below`` the object's middle; ``stands``: distances that the base may move to, at
    ``bearings`` evenly around. ``rolls`` of the sensor about its line of sight that are tried.
    """

    arm: str = BUILT_IN
    base_link: str | None = None
    flange_link: str | None = None
    mount: str | None = None
    ahead: float = 0.08
    size: float = 0.2
    distance: float = 0.6
    below: float = 0.3
    stands: tuple[float, ...] = (0.5, 0.6, 0.7)
    bearings: int = 12
    rolls: int = 8

    def __post_init__(self) -> None:
        for key in ("size", "distance"):
            if not getattr(self, key) > 0:
                raise ValueError(f"{key} is {getattr(self, key)}, expected more than 0")
        if not all(stand > 0 for stand in self.stands):
            raise ValueError(f"stands is {self.stands}, expected distances above 0")
        for key in ("bearings", "rolls"):
            if getattr(self, key) < 1:
                raise ValueError(f"{key} is {getattr(self, key)}, expected at least 1")
        if not (np.isfinite(self.below) and np.isfinite(self.ahead)):
            raise ValueError("below and ahead must be finite lengths")


class ArmScene(NamedTuple):
    """The object, its middle the world's origin, and the arm where it first stands; ``places`` (x, y, yaw) of the base.

    ``files`` that were read.
    """

    object: ObjectScene
    arm: Arm
    places: Float[np.ndarray, "c 3"]
    method: InverseKinematics
    files: list[Path]


def arm_scene(name: str, options: ArmOptions, looks: SceneOptions) -> ArmScene:
    """The object scaled and centred, the arm read and placed. Raises :class:`InputError` for a file that is no good."""
    mesh = load_object(name)
    vertices = np.asarray(mesh.vertices, np.float64)
    used = vertices[np.unique(mesh.faces)] if len(mesh.faces) else vertices
    if len(used) == 0:
        raise InputError(f"{name}: the mesh has no vertices, so there is nothing to look at.")
    middle = (used.min(axis=0) + used.max(axis=0)) / 2
    radius = float(np.linalg.norm(used - middle, axis=1).max())
    if not radius > 0:
        raise InputError(f"{name}: all vertices lie in one point, so there is nothing to look at.")
    scaled = ObjectMesh((vertices - middle) * options.size / (2 * radius), mesh.faces)
    mount, files = _mount(options), [Path(options.mount)] if options.mount else []
    if options.arm == BUILT_IN:
        arm = gt6a_like(1.0, mount)
    else:
        files.append(Path(options.arm))
        arm = load_arm(options.arm, options.base_link, options.flange_link, T_flange_sensor=mount)
    first = se3.compose(np.eye(3), np.array([0.0, 0.0, -options.below]))
    here = base_poses(first, bases_around(np.zeros(3), np.array([options.distance]), np.array([np.pi])))[0]
    around = np.linspace(0, 2 * np.pi, options.bearings, endpoint=False)
    places = bases_around(np.zeros(3), np.array(options.stands), around) if options.stands else np.zeros((0, 3))
    method = InverseKinematics(rolls=options.rolls)
    return ArmScene(object_scene(name, scaled, looks), arm.at(here), places, method, files)


def _mount(options: ArmOptions) -> Float[np.ndarray, "4 4"]:
    """T_flange_sensor."""
    if options.mount is None:
        return se3.compose(np.eye(3), np.array([0.0, 0.0, options.ahead]))
    return load_transform(options.mount, "T_hand_camera")
