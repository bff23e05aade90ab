"""Camera motions from images of an unknown scene: Euclidean reconstruction, poses up to one scale (pycolmap, CPU).

RR-3507 ch. 4: no target. With the camera's intrinsic parameters known, points matched between the images give the
camera's poses and the scene together, up to a similarity. Their unit is the one unknown scale of ``self_calibrate``,
and of ``calibrate_poses(..., Setup.MOVING_FRAMES, unknown_scale=True)``.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.errors import InputError, RunError
from jaxmodel.geometry import se3
from jaxmodel.scan.camera import Camera

THREADS = 2
SEED = 0
RATIO = 0.8  # Lowe (2004): nearest over second nearest descriptor
EPIPOLAR_ERROR_PX = 2.0
FEWEST_MATCHES = 15
HALF_PIXEL = 0.5  # COLMAP's pixel centres are at .5


@dataclass(frozen=True)
class SceneMotions:
    """Poses of the camera in the scene's own frame and unit.

    ``T_scene_camera (n, 4, 4)``: NaN for images that were not ``registered``; the camera moves by
    ``A = T_scene_camera[j]^-1 T_scene_camera[i]``. The scene's origin is in the middle of its points: an image knows
    where that is better than where the camera itself is, whose place errs with its rotation, and ``joint`` takes the
    errors of both for independent. ``reprojection_px``: mean distance between the points seen and
    those of the reconstruction, after distortion is taken out; ``points``: how many points it has.
    """

    T_scene_camera: Float[np.ndarray, "n 4 4"]
    registered: Bool[np.ndarray, " n"]
    reprojection_px: float
    points: int
    camera: Camera


def scene_motions(images: Sequence[Path], camera: Camera, features: int = 2000) -> SceneMotions:
    """Camera poses from images of a scene of which nothing is known, by SIFT and incremental mapping.

    The scene must be rigid, textured, and not be one plane seen by turning the camera about its centre: translations
    need parallax. About ``features`` points an image are used. Same images, same answer: seeds are fixed. Raises
    :class:`InputError` for an unreadable image, one whose size is not the camera's, fewer than three images or absent
    pycolmap; :class:`RunError` where no two images can be related.
    """
    pycolmap = _pycolmap()
    greys = [_grey(pycolmap, path, camera) for path in images]
    options = pycolmap.FeatureExtractionOptions(num_threads=THREADS, use_gpu=False)
    options.sift.max_num_features = features
    pixels, descriptors = [], []
    with _quiet(pycolmap):
        extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
        extracted = [extractor.extract_from_uint8_array(grey) for grey in greys]
    for keypoints, found in extracted:
        pixels.append(np.array([[point.x, point.y] for point in keypoints]).reshape(-1, 2) - HALF_PIXEL)
        descriptors.append(found.data.astype(np.float32).reshape(-1, 128))
    matches = {(i, j): _match(descriptors[i], descriptors[j]) for i, j in combinations(range(len(images)), 2)}
    return reconstruct(pixels, matches, camera)


def corner_motions(corners: Float[np.ndarray, "n m 2"], camera: Camera) -> SceneMotions:
    """As ``scene_motions`` from points that are known to be the same in all images (NaN: not seen there).

    With the corners of a target this is self-calibration on the target's own images without its model (RR-3507 §4.3).
    """
    seen = np.asarray(np.isfinite(corners).all(axis=2))
    pixels = [one[there] for one, there in zip(corners, seen, strict=True)]
    place = np.cumsum(seen, axis=1) - 1
    matches = {}
    for i, j in combinations(range(len(corners)), 2):
        both = np.flatnonzero(seen[i] & seen[j])
        matches[i, j] = np.stack([place[i, both], place[j, both]], axis=1)
    return reconstruct(pixels, matches, camera)


def reconstruct(
    pixels: Sequence[Float[np.ndarray, "_ 2"]],
    matches: Mapping[tuple[int, int], Int[np.ndarray, "_ 2"]],
    camera: Camera,
) -> SceneMotions:
    """Poses and points from matched pixels: two-view geometries, incremental mapping, bundle adjustment; K is kept.

    ``matches[i, j]`` pairs rows of ``pixels[i]`` and ``pixels[j]``, i < j.
    """
    if len(pixels) < 2:
        raise InputError(f"{len(pixels)} image gives no motion; at least 3 are needed.")
    pycolmap = _pycolmap()
    if len(pixels) < 3:
        raise InputError("2 images of an unknown scene are too few: a point counts once a third image agrees on it.")
    with _quiet(pycolmap):
        models = _map(pycolmap, [_ideal(camera, one) for one in pixels], matches, camera)
    if not models:
        raise RunError(
            f"No two of the {len(pixels)} images could be related: they need a rigid, textured scene seen from places "
            "that overlap and are apart."
        )
    model = max(models, key=lambda one: (one.num_reg_images(), one.num_points3D()))
    middle = np.median([point.xyz for point in model.points3D.values()], axis=0)
    poses = np.full((len(pixels), 4, 4), np.nan)
    for number, image in model.images.items():
        if image.has_pose:
            matrix = np.asarray(image.cam_from_world().matrix(), np.float64)
            poses[number - 1] = se3.inverse(se3.compose(matrix[:, :3], matrix[:, 3]))
    poses[:, :3, 3] -= middle
    error = float(model.compute_mean_reprojection_error())
    registered = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    return SceneMotions(poses, registered, error, int(model.num_points3D()), camera)


def _map(pycolmap: Any, pixels: Sequence[np.ndarray], matches: Mapping, camera: Camera) -> list[Any]:
    (fx, _, cx), (_, fy, cy), _ = camera.K
    pinhole = pycolmap.Camera(
        camera_id=1,
        model="PINHOLE",
        width=camera.width,
        height=camera.height,
        params=[fx, fy, cx + HALF_PIXEL, cy + HALF_PIXEL],
        has_prior_focal_length=True,
    )
    points = [one + HALF_PIXEL for one in pixels]
    two_views = pycolmap.TwoViewGeometryOptions(compute_relative_pose=True, min_num_inliers=FEWEST_MATCHES)
    two_views.ransac.max_error = EPIPOLAR_ERROR_PX
    two_views.ransac.random_seed = SEED
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=THREADS,
        random_seed=SEED,
        min_num_matches=FEWEST_MATCHES,
        min_model_size=2,
        multiple_models=False,
        extract_colors=False,
        ba_refine_focal_length=False,
        ba_refine_principal_point=False,
        ba_refine_extra_params=False,
    )
    options.mapper.abs_pose_min_num_inliers = FEWEST_MATCHES
    options.mapper.init_min_num_inliers = 2 * FEWEST_MATCHES
    manager = pycolmap.ReconstructionManager()
    with pycolmap.Database.open(":memory:") as database:
        _write_images(pycolmap, database, pinhole, points)
        for (i, j), pairs in sorted(matches.items()):
            if len(pairs) < FEWEST_MATCHES:
                continue
            pairs = np.ascontiguousarray(pairs, dtype=np.uint32)
            geometry = pycolmap.estimate_calibrated_two_view_geometry(
                pinhole, points[i], pinhole, points[j], pairs, two_views
            )
            database.write_matches(i + 1, j + 1, pairs)
            database.write_two_view_geometry(i + 1, j + 1, geometry)
        pycolmap.IncrementalPipeline(options, database, manager).run()
    return [manager.get(k) for k in range(manager.size())]


def _write_images(pycolmap: Any, database: Any, pinhole: Any, points: Sequence[np.ndarray]) -> None:
    """Images 1 to n of one camera, each its own frame of a rig that holds this camera alone."""
    database.write_camera(pinhole, use_camera_id=True)
    rig = pycolmap.Rig(rig_id=1)
    rig.add_ref_sensor(pinhole.sensor_id)
    database.write_rig(rig, use_rig_id=True)
    for number, keypoints in enumerate(points, start=1):
        image = pycolmap.Image(name=str(number), camera_id=1, image_id=number)
        image.frame_id = number
        frame = pycolmap.Frame(frame_id=number, rig_id=1)
        frame.add_data_id(image.data_id)
        database.write_frame(frame, use_frame_id=True)
        database.write_image(image, use_image_id=True)
        database.write_keypoints(number, keypoints.astype(np.float32))


def _ideal(camera: Camera, pixels: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2"]:
    """Pixels as the same camera without distortion would have them."""
    return camera.undistort(pixels) * np.diag(camera.K)[:2] + camera.K[:2, 2]


def _match(a: Float[np.ndarray, "p d"], b: Float[np.ndarray, "q d"]) -> Int[np.ndarray, "k 2"]:
    """Mutually nearest descriptors (by angle), each clearly nearer than the second nearest (Lowe 2004)."""
    if min(len(a), len(b)) < 2:
        return np.zeros((0, 2), int)
    a, b = (one / np.maximum(np.linalg.norm(one, axis=1, keepdims=True), 1e-9) for one in (a, b))
    cosine = a @ b.T
    nearest, back, row = cosine.argmax(axis=1), cosine.argmax(axis=0), np.arange(len(a))
    first = cosine[row, nearest].copy()
    cosine[row, nearest] = -1.0
    clear = np.arccos(np.minimum(first, 1.0)) < RATIO * np.arccos(np.minimum(cosine.max(axis=1), 1.0))
    kept = np.flatnonzero(clear & (back[nearest] == row))
    return np.stack([kept, nearest[kept]], axis=1)


def _grey(pycolmap: Any, path: Path, camera: Camera) -> np.ndarray:
    if not Path(path).is_file():
        raise InputError(f"There is no file {path}.")
    bitmap = pycolmap.Bitmap.read(str(path), as_rgb=False)
    if bitmap is None:
        raise InputError(f"{path} cannot be read as an image.")
    grey = np.ascontiguousarray(bitmap.to_array(), dtype=np.uint8).reshape(bitmap.height, bitmap.width)
    if grey.shape != (camera.height, camera.width):
        raise InputError(
            f"{path} has {grey.shape[1]} x {grey.shape[0]} pixels, but the camera is for {camera.width} x "
            f"{camera.height}."
        )
    return grey


@contextmanager
def _quiet(pycolmap: Any) -> Iterator[None]:
    """COLMAP's progress lines kept off the terminal."""
    level = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = level


def _pycolmap() -> Any:
    try:
        import pycolmap
    except ImportError:
        raise InputError(
            "Motions from images of an unknown scene need pycolmap; install it with: pip install 'jaxmodel[sfm]'."
        ) from None
    return pycolmap
