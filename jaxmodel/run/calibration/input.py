"""From the files of a hand-eye calibration to paired poses, checked: one row each of the hand and the camera."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxmodel.calibrate.synchronise import ordered, synchronise
from jaxmodel.errors import InputError
from jaxmodel.io.pose_files import read_both, read_single
from jaxmodel.io.pose_values import Forms, PoseStream
from jaxmodel.run.calibration.config import Config
from jaxmodel.run.calibration.images import poses_of_images
from jaxmodel.run.calibration.paired_poses import PairedPoses
from jaxmodel.run.calibration.scene import poses_of_scene


def load_poses(config: Config) -> PairedPoses:
    """Read everything ``config`` names and pair it; anything wrong is an ``InputError`` naming file and row."""
    forms = config.forms
    if config.scales != "known":  # lengths of any unit: nothing to ask about
        forms = Forms(forms.hand, replace(forms.camera, length=forms.camera.length or "m"))
    path = Path(config.poses)
    if config.images is not None and config.images.target is None:
        if config.setup != "moving-frames" or config.scales == "known":
            raise InputError(
                f"{config.images.folder}: without a target the pictures give the camera's own poses in an unknown "
                "unit: expected --setup moving-frames and --unknown-scale, or a --target"
            )
        paired = poses_of_scene(read_single(path, "hand", forms), config.images)
    elif config.images is not None:
        if config.setup == "moving-frames":
            raise InputError("setup is moving-frames, but images give T_camera_target: expected eye-in-hand or "
                             "eye-to-hand")  # fmt: skip
        paired = poses_of_images(read_single(path, "hand", forms), config.images)
    elif config.camera_poses is None:
        hand, camera = read_both(path, forms)
        paired = _paired(hand, camera, config)
    else:
        hand, camera = read_single(path, "hand", forms), read_single(Path(config.camera_poses), "camera", forms)
        paired = _paired(hand, camera, config)
    n = len(paired.hand)
    if n < 2:
        raise InputError(f"{path}: {n} pose gives no motion; at least 2 are needed, 3 for a whole answer")
    if config.scales == "per-group" and paired.groups is None:
        raise InputError(f"{path}: scales per-group need a column 'group' that names each pose's group")
    if config.scales == "per-group" and len(set(paired.groups or ())) == n:
        raise InputError(f"{path}: no group holds two poses, so none has a motion")
    if n > config.most_poses:
        paired = paired.rows(np.unique(np.linspace(0, n - 1, config.most_poses).round().astype(int)))
        note = f"{len(paired.hand)} of {n} poses are used, evenly spread; --most-poses takes more"
        paired = replace(paired, notes=(*paired.notes, note))
    return paired


def _paired(hand: PoseStream, camera: PoseStream, config: Config) -> PairedPoses:
    files = tuple(dict.fromkeys((*hand.files, *camera.files)))
    groups = camera.groups or hand.groups
    if config.time_offset is not None:
        return _synchronised(hand, camera, config, files)
    if hand.images is not None and camera.images is not None and hand.path != camera.path:
        camera = _in_order_of(hand, camera)
    if hand.times is not None and camera.times is not None and not _together(hand.times, camera.times):
        raise InputError(
            f"{hand.path} and {camera.path} are not sampled together ({len(hand.poses)} poses and {len(camera.poses)}, "
            "their times differ); say --time-offset auto, or the offset in seconds"
        )
    if len(hand.poses) != len(camera.poses):
        raise InputError(
            f"{hand.path} holds {len(hand.poses)} poses of the hand and {camera.path} {len(camera.poses)} of the "
            "camera; each row needs both"
        )
    return PairedPoses(hand.poses, camera.poses, _places(hand, camera), files, groups)


def _places(hand: PoseStream, camera: PoseStream) -> tuple[str, ...]:
    if hand.places == camera.places:
        return hand.places
    return tuple(f"{one} and {other}" for one, other in zip(hand.places, camera.places, strict=True))


def _together(first: Float[np.ndarray, " n"], second: Float[np.ndarray, " m"]) -> bool:
    """Whether two streams have the same times, up to a hundredth of their spacing."""
    if len(first) != len(second):
        return False
    spacing = float(np.median(np.abs(np.diff(first)))) if len(first) > 1 else 0.0
    return bool(np.abs(first - second).max(initial=0.0) <= 0.01 * spacing)


def _in_order_of(hand: PoseStream, camera: PoseStream) -> PoseStream:
    """The camera's poses in the order of the hand's names."""
    assert hand.images is not None and camera.images is not None
    absent = sorted(set(hand.images) ^ set(camera.images))
    if absent or len(set(hand.images)) != len(hand.images) or len(hand.images) != len(camera.images):
        name = absent[0] if absent else next(n for n in hand.images if hand.images.count(n) > 1)
        raise InputError(f"{hand.path} and {camera.path} do not name the same poses once each; see {name!r}")
    order = np.array([camera.images.index(name) for name in hand.images])
    groups = None if camera.groups is None else tuple(camera.groups[k] for k in order)
    return replace(camera, poses=camera.poses[order], places=tuple(camera.places[k] for k in order), groups=groups)


def _synchronised(hand: PoseStream, camera: PoseStream, config: Config, files: tuple[Path, ...]) -> PairedPoses:
    for stream in (hand, camera):
        if stream.times is None:
            raise InputError(
                f"{stream.path}: has no times, which --time-offset needs; expected a column 't' in seconds"
            )
        if len(stream.poses) < 3:
            raise InputError(f"{stream.path}: {len(stream.poses)} poses are too few for --time-offset; 3 are needed")
    assert hand.times is not None and camera.times is not None
    offset = None if config.time_offset == "auto" else config.time_offset
    streams = ordered(hand.times, hand.poses), ordered(camera.times, camera.poses)
    both = synchronise(*streams, config.largest_offset_s, offset)
    rows = np.unique(camera.times, return_index=True)[1][np.searchsorted(streams[1].times, both.times)]
    notes = []
    if offset is None and both.sharpness < 1.5:
        notes.append(f"the streams hardly tell their time offset (sharpness {both.sharpness:.2f}, 1 is none)")
    if offset is None and abs(abs(both.offset_s) - config.largest_offset_s) < 0.02 * config.largest_offset_s:
        notes.append(f"the time offset lies at the end of what was searched, {config.largest_offset_s:g} s")
    return PairedPoses(
        both.hand, both.camera, tuple(camera.places[k] for k in rows), files, None, both, tuple(notes)
    )  # fmt: skip
