"""Pictures given to the command: the Franka set of ViSP, from its images to its published answer."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.run.cli import execute

PUBLISHED = {"translation": (0.05772, -0.03392, -0.04228), "rotation_vector": (0.00178, 0.00917, 1.58178)}
"""What ViSP's documentation prints for these files (metre, radian)."""


@pytest.mark.data
@pytest.mark.slow
def test_franka_from_its_images(tmp_path, data_dir):
    """Within 2 mm and 0.5 degrees of the published answer; six motions more than are needed leave no verdict open."""
    pytest.importorskip("cv2")
    folder, out = data_dir / "handeye" / "visp_franka_eye_in_hand", tmp_path / "out"
    camera = str(folder / "franka_camera.xml")
    words = ["--images", str(folder), "--camera", camera, "--target", "chessboard:9x6:0.0236", "--method", "joint"]
    assert execute(["calibrate", str(folder), *words, "--out", str(out)]) == 0
    found = json.loads((out / "calibration.json").read_text())
    T = np.array(found["T_hand_camera"])
    published = Rotation.from_rotvec(PUBLISHED["rotation_vector"]).as_matrix()
    assert np.linalg.norm(T[:3, 3] - PUBLISHED["translation"]) < 0.002
    assert np.degrees(Rotation.from_matrix(T[:3, :3] @ published.T).magnitude()) < 0.5
    # the sheet that the board is printed on has the sides of A4, which makes its squares 26.1 mm (1.106 times 23.6 mm)
    notes = json.loads((out / "summary.json").read_text())["notes"]
    (note,) = [note for note in notes if "the camera's lengths would fit the hand's better times" in note]
    times, deviation = (float(note.split(word)[1].split()[0].strip("),")) for word in ("times ", "deviation "))
    assert abs(times - 1.106) < 2.1 * deviation < times - 1.0  # 95 % of Student's 17 degrees of freedom
    inputs = json.loads((out / "manifest.json").read_text())["inputs"]
    assert len([name for name in inputs if name.endswith(".png")]) == 8 and camera in inputs
    assert len([name for name in inputs if "pose_rPe" in name]) == 8
