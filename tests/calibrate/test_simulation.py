"""Simulated problems: draws that do not depend on their batch, the report's noise, robots whose cameras look."""

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import simulated_robot as robot
from jaxmodel.calibrate import simulation
from jaxmodel.geometry import se3

IMAGE = robot.Image(800.0, 0.3)


def test_draws_do_not_depend_on_their_batch() -> None:
    whole = simulation.normals(3, 1, 0, 50, 7)
    np.testing.assert_array_equal(simulation.normals(3, 1, 20, 5, 7), whole[20:25])
    assert not np.isclose(simulation.normals(3, 2, 0, 50, 7), whole).any()
    many = simulation.normals(0, 0, 0, 4000, 4)
    assert abs(many.mean()) < 5 / np.sqrt(many.size) and abs(many.std() - 1) < 5 / np.sqrt(2 * many.size)


def test_the_reports_noise_is_relative_in_angles_and_translation() -> None:
    drawn = simulation.normals(0, 0, 0, 40, 12)
    A = simulation.rigid(drawn[:, :6], 0.5, 2.0)
    np.testing.assert_allclose(simulation.with_report_noise(A, 0.0, drawn[:, 6:]), A, atol=1e-14)
    noisy = simulation.with_report_noise(A, 0.1, drawn[:, 6:])
    shift = (noisy - A)[:, :3, 3] / np.linalg.norm(A[:, :3, 3], axis=1)[:, None]
    np.testing.assert_allclose(shift, 0.1 * drawn[:, 9:], atol=1e-12)
    angles = [Rotation.from_matrix(T[:, :3, :3]).as_euler("xyz") for T in (A, noisy)]
    np.testing.assert_allclose(angles[1] / angles[0] - 1, 0.1 * drawn[:, 6:9], atol=1e-9)


def test_conjugate_motions_solve_the_equation() -> None:
    drawn = simulation.normals(1, 0, 0, 3, 6 + 24)
    X, B = simulation.rigid(drawn[:, :6], 1.0, 1.0), simulation.rigid(drawn[:, 6:].reshape(3, 4, 6), 1.0, 1.0)
    np.testing.assert_allclose(simulation.conjugate(X, B) @ X[:, None], X[:, None] @ B, atol=1e-12)
    angle, shift = simulation.errors(np.concatenate([X[:2], np.full((1, 4, 4), np.nan)]), X)
    assert angle[:2].max() < 1e-6 and shift[:2].max() < 1e-12 and np.isnan([angle[2], shift[2]]).all()


def robot_with_camera(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    drawn = simulation.normals(seed, 0, 0, 1, 6 + 3 * 80)[0]
    return simulation.rigid(drawn[:6], 1.0, 0.06), np.mod(drawn[6:].reshape(-1, 3), 1.0)


def test_every_camera_looks_at_the_target() -> None:
    T_hand_camera, uniform = robot_with_camera()
    hands = [
        robot.far_positions(uniform, 33, T_hand_camera, (1.0, 0.7)),
        robot.near_positions(uniform[:9], 0.1, T_hand_camera),
        robot.exponential_positions(T_hand_camera, 0.9, 0.3, 60, 0.1)[:3],
    ]
    for hand in hands:
        origin = robot.camera_poses(hand, T_hand_camera)[:, :3, 3]
        np.testing.assert_allclose(origin[:, :2], 0.0, atol=1e-12)
        assert (origin[:, 2] > 0.39).all() and (origin[:, 2] < 0.61).all()


def test_far_positions_turn_further_than_the_order_they_were_drawn_in() -> None:
    T_hand_camera, uniform = robot_with_camera()
    drawn = robot.look((2 * uniform[:, :2] - 1) * (1.0, 0.7), np.full(len(uniform), 0.5), T_hand_camera)
    far = robot.far_positions(uniform, 20, T_hand_camera, (1.0, 0.7))
    turns = [np.mean(se3.rotation_angle_deg(robot.consecutive(hand, False)[:, :3, :3])) for hand in (far, drawn[:20])]
    assert turns[0] > turns[1]


def test_the_small_motions_decay_exponentially() -> None:
    T_hand_camera, _ = robot_with_camera()
    hand = robot.exponential_positions(T_hand_camera, 0.9, 0.3, 60, 0.1)
    assert len(hand) == 63
    steps = np.linalg.norm(np.diff(hand[2:, :3, 3], axis=0), axis=1)
    np.testing.assert_allclose(steps[1:] / steps[:-1], np.exp(-0.1), rtol=1e-6)
    turns = se3.rotation_angle_deg(robot.consecutive(hand, False)[:, :3, :3])
    np.testing.assert_allclose(turns[:2], np.degrees(0.9), rtol=1e-9)
    assert turns[2] < 3 and turns[-1] < 0.01


def test_poses_from_a_target_err_as_least_squares_on_its_pixels_do() -> None:
    from scipy.optimize import least_squares

    T_hand_camera, uniform = robot_with_camera()
    camera = robot.camera_poses(robot.near_positions(uniform[:3], 0.3, T_hand_camera), T_hand_camera)
    points = robot.board(camera)

    def pixels(pose: np.ndarray) -> np.ndarray:
        seen = se3.apply(pose, points)
        return (IMAGE.focal * seen[:, :2] / seen[:, 2:]).ravel()

    def moved(v: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(v[:3]).as_matrix()
        return se3.compose(turn @ camera[0, :3, :3], camera[0, :3, 3] + v[3:])

    random, fitted = np.random.default_rng(0), []
    for _ in range(150):
        measured = pixels(camera[0]) + IMAGE.noise * random.normal(size=2 * len(points))
        fit = least_squares(lambda v, m=measured: pixels(moved(v)) - m, np.zeros(6), method="lm", x_scale=1.0)
        fitted.append(fit.x)
    simulated = []
    for drawn in simulation.normals(0, 9, 0, 150, 18):
        pose = robot.seen(camera, points, IMAGE, drawn, True)[0]
        turn = Rotation.from_matrix(pose[:3, :3] @ camera[0, :3, :3].T).as_rotvec()
        simulated.append(np.concatenate([turn, pose[:3, 3] - camera[0, :3, 3]]))
    # standard deviations of 150 draws are known to 6 %: four of their differences' deviations
    ratio = np.std(simulated, axis=0) / np.std(fitted, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=4 * np.sqrt(2) * 0.058)


def test_a_reconstruction_errs_more_than_a_known_target_and_keeps_its_scale_free() -> None:
    T_hand_camera, uniform = robot_with_camera()
    camera = robot.camera_poses(robot.far_positions(uniform, 6, T_hand_camera, (1.0, 0.7)), T_hand_camera)
    points, spreads = robot.board(camera), []
    for known in (True, False):
        errors = []
        for drawn in simulation.normals(0, 5, 0, 40, 36):
            A = robot.consecutive(robot.seen(camera, points, IMAGE, drawn, known), True)
            true = robot.consecutive(camera, True)
            errors.append(se3.rotation_angle_deg(A[:, :3, :3] @ np.swapaxes(true[:, :3, :3], 1, 2)))
        spreads.append(float(np.sqrt(np.mean(np.square(errors)))))
    assert 0 < spreads[0] < spreads[1]
