"""Camera files of every kind give the same camera; a bad one gets one sentence."""

import json

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.camera import load_camera
from jaxmodel.scan.camera import Camera

CAMERA = Camera(np.array([[610.5, 0, 322.25], [0, 608.75, 241.5], [0, 0, 1]]), np.array([-0.25, 0.125, 1e-3, -2e-3]))
K_ROW = "610.5, 0., 322.25, 0., 608.75, 241.5, 0., 0., 1."
D_ROW = "-0.25, 0.125, 1.0e-03, -2.0e-03, 0."

OPENCV_YAML = f"""%YAML:1.0
---
calibration_time: "a day"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {K_ROW} ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ {D_ROW} ]
"""
OPENCV_XML = f"""<?xml version="1.0"?>
<opencv_storage>
<calibration_time>"a day in May"</calibration_time>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows> <cols>3</cols> <dt>d</dt>
  <data> {K_ROW.replace(",", "")}</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows> <cols>1</cols> <dt>d</dt>
  <data> {D_ROW.replace(",", "")}</data></distortion_coefficients>
</opencv_storage>
"""
ROS_FILE = f"""image_width: 640
image_height: 480
camera_name: arm
camera_matrix:
  rows: 3
  cols: 3
  data: [{K_ROW}]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [{D_ROW}]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""
ROS_MESSAGE = f"height: 480\nwidth: 640\ndistortion_model: plumb_bob\nD: [{D_ROW}]\nK: [{K_ROW}]\n"
PLAIN_JSON = json.dumps({"K": CAMERA.K.tolist(), "distortion": CAMERA.distortion.tolist(), "width": 640, "height": 480})
FOCAL_JSON = json.dumps(
    {"fx": 610.5, "fy": 608.75, "cx": 322.25, "cy": 241.5, "dist_coeffs": [[-0.25, 0.125, 1e-3, -2e-3]]}
    | {"width": 640, "height": 480.0}
)


@pytest.mark.parametrize(
    "text",
    [OPENCV_YAML, OPENCV_XML, ROS_FILE, ROS_MESSAGE, ROS_MESSAGE.replace("K:", "k:").replace("D:", "d:"), PLAIN_JSON,
     FOCAL_JSON, PLAIN_JSON.replace("{", "").replace("}", "").replace(', "', '\n"'), "\ufeff" + ROS_FILE],
)  # fmt: skip
def test_every_form_gives_the_same_camera(tmp_path, text):
    path = tmp_path / "camera.txt"
    path.write_text(text, encoding="utf-8")
    found = load_camera(path)
    np.testing.assert_array_equal(found.K, CAMERA.K)
    np.testing.assert_array_equal(found.distortion, CAMERA.distortion)
    assert (found.width, found.height) == (640, 480)


def visp(models: str) -> str:
    size = "<image_width>640</image_width><image_height>480</image_height>"
    return f"<root><camera><name>c</name>{size}{models}</camera></root>"


WITHOUT = "<model><type>perspectiveProjWithoutDistortion</type><px>500</px><py>501</py><u0>320</u0><v0>240</v0></model>"
WITH = WITHOUT.replace("Without", "With").replace("500", "600").replace("</v0>", "</v0><kud>-0.2</kud><kdu>0.21</kdu>")


def test_visp_takes_the_model_with_distortion(tmp_path):
    path = tmp_path / "camera.xml"
    path.write_text('<?xml version="1.0"?><!-- of ViSP -->' + visp(WITHOUT + WITH))
    found = load_camera(path)
    np.testing.assert_array_equal(found.K, [[600, 0, 320], [0, 501, 240], [0, 0, 1]])
    np.testing.assert_array_equal(found.distortion, [-0.2, 0, 0, 0])
    # ViSP: u = u0 + px x (1 + kud r^2)
    x, y, s = 0.2, -0.1, 0.05
    pixel = found.project(np.array([[x, y, 1.0]]))[0]
    np.testing.assert_allclose(pixel, [320 + 600 * x * (1 - 0.2 * s), 240 + 501 * y * (1 - 0.2 * s)])
    path.write_text(visp(WITHOUT))
    assert load_camera(path).distortion.size == 0


@pytest.mark.data
def test_the_real_visp_camera(data_dir):
    found = load_camera(data_dir / "handeye" / "visp_franka_eye_in_hand" / "franka_camera.xml")
    np.testing.assert_allclose(found.K[[0, 1, 0, 1], [0, 1, 2, 2]], [607.593, 607.575, 323.463, 243.255], atol=5e-4)
    assert found.distortion.size == 0 and (found.width, found.height) == (640, 480)


@pytest.mark.data
def test_a_stereo_file_without_the_names_is_refused(data_dir):
    with pytest.raises(InputError, match=r"opencv_intrinsics\.yml: the image size is absent"):
        load_camera(data_dir / "stereo" / "chessboard_pairs" / "opencv_intrinsics.yml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected the names K"),
        ("[1, 2]", "expected the names K"),
        ("{", "neither JSON nor YAML"),
        ("a: [1", "neither JSON nor YAML"),
        ("<root>", "is not XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><root/>', "entities of its own"),
        ("<root/>", "one camera, found 0"),
        (visp(""), "expected a model perspectiveProjWithDistortion .* found none"),
        (visp(WITHOUT.replace("<px>500</px>", "")), "no <px>"),
        (visp(WITHOUT.replace("500", "wide")), "px must hold numbers"),
        (ROS_FILE.replace("plumb_bob", "equidistant"), "'equidistant' is not supported"),
        (ROS_MESSAGE.replace("width: 640", ""), "image size is absent; expected width or image_width"),
        (ROS_MESSAGE.replace("640", "wide"), "width must be a number of pixels, not 'wide'"),
        (ROS_MESSAGE.replace("640", "-640"), "at least 1 x 1"),
        (ROS_MESSAGE.replace("K:", "A:"), "camera matrix is absent"),
        (ROS_MESSAGE.replace("610.5, ", ""), "K must hold 9 numbers"),
        (ROS_MESSAGE.replace("610.5", "-610.5"), "fx, fy > 0"),
        (ROS_MESSAGE.replace("610.5", ".nan"), "not a finite number"),
        (ROS_MESSAGE.replace("610.5", "wide"), "K must hold numbers"),
        (OPENCV_YAML.replace("rows: 3", "rows: 4"), "is not an OpenCV FileStorage"),
        (OPENCV_XML.replace("610.5", "wide"), "camera_matrix must hold numbers"),
        (ROS_MESSAGE.replace(D_ROW, "0, 0, 0, 0, 0, 0, 0, 0, 0.1"), "thin-prism and tilt"),
    ],
)
def test_a_bad_file_is_named(tmp_path, text, message):
    path = tmp_path / "bad.cam"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"bad\.cam.*{message}") as caught:
        load_camera(path)
    assert "\n" not in str(caught.value)


def test_absent_and_binary_files_are_named(tmp_path):
    with pytest.raises(InputError, match=r"There is no file .*none\.yml"):
        load_camera(tmp_path / "none.yml")
    (tmp_path / "binary.yml").write_bytes(bytes(range(128, 256)))
    with pytest.raises(InputError, match=r"binary\.yml cannot be read as text"):
        load_camera(tmp_path / "binary.yml")
