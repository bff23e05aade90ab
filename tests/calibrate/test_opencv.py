"""OpenCV's five hand-eye methods on the same noisy poses: the same algorithm gives the same answer.

Oracle: cv2.calibrateHandEye.
"""

import numpy as np
import pytest
from calibration_cases import Simulation, errors, motion

from jaxmodel.calibrate import calibrate_poses, solve
from jaxmodel.calibrate.many_poses import solve_many_poses
from jaxmodel.geometry import se3

cv2 = pytest.importorskip("cv2", reason="the extra `images` is not installed")
if not hasattr(cv2, "calibrateHandEye"):
    pytest.skip("this OpenCV has no calibrateHandEye", allow_module_level=True)

THEIRS = {
    "tsai_lenz": "TSAI",
    "park": "PARK",
    "quaternion": "HORAUD",
    "linear_one_step": "ANDREFF",
    "dual_quaternion": "DANIILIDIS",
}


def noisy_poses(seed: int, noise: float, angle_of_X: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Six poses whose fifteen motions turn by 20 to 110 degrees: what OpenCV's TSAI keeps.

    Lengths are in units of the motions' root mean square: ours takes it for dual quaternions, OpenCV the data's unit.
    """
    s = Simulation(seed)
    X, Z = s.X(angle_of_X), s.X()
    while True:
        hand = np.stack([motion(s.rng.uniform(0.2, 0.95) * s.unit(), 0.5 * s.rng.normal(size=3)) for _ in range(6)])
        angles = se3.rotation_angle_deg(motions_of(hand, hand)[0][:, :3, :3])
        if angles.min() > 20 and angles.max() < 110:
            camera = s.noisy(np.linalg.inv(hand @ X) @ Z, noise, noise)
            moved = np.concatenate(motions_of(hand, camera))[:, :3, 3]
            for T in (hand, camera, X):
                T[..., :3, 3] /= np.sqrt(np.mean(np.sum(moved**2, axis=1)))
            return hand, camera, X


def motions_of(hand: np.ndarray, camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs as OpenCV forms them: A of the hand, B of the camera, X = T_hand_camera."""
    i, j = np.triu_indices(len(hand), 1)
    return se3.inverse(hand[j]) @ hand[i], camera[j] @ se3.inverse(camera[i])


def theirs(name: str, hand: np.ndarray, camera: np.ndarray) -> np.ndarray:
    R, t = cv2.calibrateHandEye(
        list(hand[:, :3, :3]),
        list(hand[:, :3, 3]),
        list(camera[:, :3, :3]),
        list(camera[:, :3, 3]),
        method=getattr(cv2, f"CALIB_HAND_EYE_{name}"),
    )
    return se3.compose(R, t[:, 0])


@pytest.mark.parametrize("method", THEIRS)
@pytest.mark.parametrize(("seed", "noise"), [(0, 0.003), (1, 0.01), (2, 0.03)])
def test_the_same_algorithm_gives_the_same_answer(method, seed, noise):
    hand, camera, X = noisy_poses(seed, noise)
    A, B = motions_of(hand, camera)
    ours, reference = solve(A, B, method).X, theirs(THEIRS[method], hand, camera)
    np.testing.assert_allclose(ours, reference, rtol=0, atol=1e-6)
    assert errors(reference, X)[0] > 1e-4  # the noise is there


def test_one_step_over_sums_of_poses_is_andreff():
    """A list of poses and its reverse: OpenCV then forms each pair as often in the one as in the other direction."""
    hand, camera, X = (np.stack(each) for each in zip(*(noisy_poses(20 + k, 0.01) for k in range(4)), strict=True))
    found = solve_many_poses(hand, camera, method="linear_one_step")
    for one, h, c, true in zip(found, hand, camera, X, strict=True):
        reference = theirs("ANDREFF", np.concatenate([h, h[::-1]]), np.concatenate([c, c[::-1]]))
        np.testing.assert_allclose(one, reference, rtol=0, atol=1e-6)
        assert errors(reference, true)[0] > 1e-4


def test_the_same_poses_give_answers_within_the_noise():
    """``calibrate_poses`` names the same T_hand_camera as OpenCV, its equations written in the camera's frame."""
    hand, camera, _ = noisy_poses(3, 1e-6)
    for method, name in THEIRS.items():
        found = calibrate_poses(hand, camera, method=method).transforms["T_hand_camera"]
        np.testing.assert_allclose(found, theirs(name, hand, camera), atol=2e-5)


def test_where_x_is_nearly_a_half_turn_ours_is_the_better_tsai_lenz():
    """OpenCV's TSAI divides by what vanishes there; a first turn of B keeps the accuracy of the others."""
    worse = 0
    for seed in range(4):
        hand, camera, X = noisy_poses(10 + seed, 0.01, angle_of_X=np.radians(179.0))
        A, B = motions_of(hand, camera)
        ours, others = errors(solve(A, B, "tsai_lenz").X, X)[0], errors(solve(A, B, "linear").X, X)[0]
        assert ours < 1.5 * others + 1e-3
        worse += errors(theirs("TSAI", hand, camera), X)[0] > 2 * ours
    assert worse >= 3
