"""``jaxmodel calibrate`` states a deviation that the data bear out, and says where they show more than noise."""

import json
from pathlib import Path
from typing import Any

import hand_eye_files as files
import numpy as np
import pytest
from scipy.stats import chi2

from jaxmodel.calibrate.resampling import differences
from jaxmodel.run.cli import execute


def calibrated(tmp_path: Path, *words: object) -> dict[str, Any]:
    assert execute(["calibrate", *map(str, words), "--out", str(tmp_path / "out")]) == 0
    return json.loads((tmp_path / "out" / "summary.json").read_text())


def streams(seed: int, n: int = 14) -> tuple[np.ndarray, np.ndarray]:
    hand, camera = files.streams(n=n, seed=seed)
    return hand, files.noisy(camera, seed=seed)


def test_sound_poses_state_the_deviation_of_their_noise(tmp_path):
    hand, camera = streams(1)
    found = calibrated(tmp_path, files.write(tmp_path / "poses.csv", hand=hand, camera=camera), "--method", "joint")
    covariance, chosen = found["recommended"]["covariance"], found["recommended"]
    assert covariance["widened_by"] == [] and covariance["matrix"] == covariance["of_the_noise_alone"]
    assert found["noise"] == "camera" and found["notes"] == [] and ";" not in chosen["reason"]
    e = differences(np.array([chosen["T_hand_camera"]]), files.X)[0]
    assert e @ np.linalg.solve(np.array(covariance["matrix"]), e) < chi2.ppf(0.999, 6)


def test_a_target_of_the_wrong_size_is_asked_about_and_widens_the_deviation(tmp_path):
    hand, camera = streams(2)
    camera[:, :3, 3] *= 0.95
    found = calibrated(tmp_path, files.write(tmp_path / "poses.csv", hand=hand, camera=camera), "--method", "joint")
    chosen = found["recommended"]
    assert any("check the size of the target's squares" in n for n in found["notes"])
    assert "scale" in chosen["covariance"]["widened_by"] and "so the deviation stated is" in chosen["reason"]
    e = differences(np.array([chosen["T_hand_camera"]]), files.X)[0]
    assert e @ np.linalg.solve(np.array(chosen["covariance"]["matrix"]), e) < chi2.ppf(0.999, 6)
    deviation = np.sqrt(np.diag(np.array(chosen["covariance"]["matrix"])))
    np.testing.assert_allclose(chosen["deviation"]["translation_m"], deviation[3:], rtol=1e-12)


def test_a_robust_loss_is_a_word_of_the_command(tmp_path):
    hand, camera = streams(3)
    right = files.write(tmp_path / "right.csv", hand=np.delete(hand, [4, 8], 0), camera=np.delete(camera, [4, 8], 0))
    alone = calibrated(tmp_path, right, "--method", "joint")["recommended"]
    camera[[4, 8]] = camera[[8, 4]]
    path = files.write(tmp_path / "wrong.csv", hand=hand, camera=camera)
    (tmp_path / "robust").mkdir()
    found = calibrated(tmp_path / "robust", path, "--method", "joint", "--loss", "tukey")
    chosen = found["recommended"]
    assert found["loss"] == "tukey" and "the loss tukey weighs down 2 of 14 poses" in chosen["reason"]
    assert len(chosen["outliers"]) == 2
    errors = [np.abs(differences(np.array([one["T_hand_camera"]]), files.X)[0]) for one in (chosen, alone)]
    deviation = np.sqrt(np.diag(np.array(alone["covariance"]["matrix"])))
    assert (errors[0] < errors[1] + deviation).all()


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [("lixiny_aruco/TransformPairsInput.yml", "--setup", "moving-frames"),
     ("fishros_aubo_i5/base_aubo_i5_data.csv", "--angle", "deg")],
    ids=["lixiny", "aubo"],
)  # fmt: skip
def test_real_sets_state_a_deviation_that_holds_what_their_methods_differ_by(tmp_path, data_dir, words):
    """No truth is known; in no component do the methods on pairs differ from joint by three stated deviations."""
    found = calibrated(tmp_path, data_dir / "handeye" / words[0], *words[1:], "--method", "all")
    chosen = found["recommended"]
    methods = {one["method"]: np.array(one["T_hand_camera"]) for one in found["methods"]}
    assert chosen["covariance"]["widened_by"]
    assert "so the deviation stated is" in chosen["reason"]
    deviation = np.sqrt(np.diag(np.array(chosen["covariance"]["matrix"])))
    noise_alone = np.sqrt(np.diag(np.array(chosen["covariance"]["of_the_noise_alone"])))
    d = {m: np.abs(differences(T[None], np.array(chosen["T_hand_camera"]))[0]) for m, T in methods.items()}
    for method in ("linear", "linear_one_step", "tsai_lenz", "park", "nonlinear", "nonlinear_b"):
        assert (d[method] < 3 * deviation).all(), method
    assert (d["linear"] > 3 * noise_alone).any()
