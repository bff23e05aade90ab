"""Pictures of a scene of which nothing is known in place of the camera's poses: no target, one unknown scale."""

from pathlib import Path

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.io.pose_values import PoseStream
from jaxmodel.run.calibration.config import Images
from jaxmodel.run.calibration.images import matched, pictures
from jaxmodel.run.calibration.paired_poses import PairedPoses

FEWEST = 3


def poses_of_scene(hand: PoseStream, images: Images) -> PairedPoses:
    """Hand poses paired with the camera's own, in the scene's frame and unit; pictures that fit no other are named."""
    files = pictures(Path(images.folder))
    chosen = matched(hand, files, Path(images.folder))
    if len(chosen) < FEWEST:
        raise InputError(
            f"{images.folder}: {len(chosen)} pictures of a scene are too few; at least {FEWEST} are needed"
        )
    if images.camera is None:
        raise InputError(
            f"{images.folder}: pictures without a target do not tell the camera's intrinsics; give --camera"
        )
    from jaxmodel.calibrate.unknown_scene import scene_motions
    from jaxmodel.io.camera import load_camera

    found = scene_motions(chosen, load_camera(Path(images.camera)))
    seen = np.flatnonzero(found.registered)
    lost = [file.name for file, there in zip(chosen, found.registered, strict=True) if not there]
    if len(seen) < FEWEST:
        without = f" (not {', '.join(lost)})" if lost else ""
        raise InputError(
            f"{images.folder}: {len(seen)} of {len(chosen)} pictures show one scene{without}; at least {FEWEST} are "
            "needed, taken from places that are apart and turned about different axes"
        )
    notes = [f"these pictures fit no other and are left out: {', '.join(lost)}"] if lost else []
    notes.append(
        f"the scene is rebuilt from {len(seen)} of {len(chosen)} pictures: {found.points} points, "
        f"{found.reprojection_px:.3g} px (mean)"
    )
    notes.append(
        "poses of one reconstruction share their errors, which the standard deviation takes for independent: count on "
        "twice as much"
    )
    inputs = (*hand.files, *chosen, Path(images.camera))
    names = tuple(file.name for file in chosen)
    whole = PairedPoses(hand.poses, found.T_scene_camera, names, inputs, hand.groups, None, tuple(notes))
    return whole.rows(seen)
