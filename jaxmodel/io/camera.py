"""Camera files: OpenCV's FileStorage, ROS camera_info, ViSP XML, plain JSON or YAML."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.io.opencv_storage import read_opencv_storage
from jaxmodel.scan.camera import Camera

MATRIX = ("K", "k", "camera_matrix", "cameraMatrix", "CameraMatrix")
FOCAL = ("fx", "fy", "cx", "cy")
DISTORTION = ("distortion", "distortion_coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "D", "d")
WIDTH, HEIGHT = ("width", "image_width", "image_Width"), ("height", "image_height", "image_Height")
DISTORTION_MODELS = ("", "none", "plumb_bob", "rational_polynomial", "opencv", "radtan")
VISP = "perspectiveProjWithDistortion", "perspectiveProjWithoutDistortion"


def load_camera(path: str | Path) -> Camera:
    """A camera's intrinsic parameters from a file, by its content and not by its name.

    OpenCV's FileStorage (YAML or XML: ``camera_matrix``, ``distortion_coefficients``, ``image_width``,
    ``image_height``), ROS camera_info (the calibration file or the message, ``plumb_bob`` or
    ``rational_polynomial``), ViSP's XML (``kud`` is OpenCV's k1), or plain JSON / YAML with ``K`` (3 x 3, or 9 numbers
    row by row) or ``fx, fy, cx, cy``, ``distortion`` (optional), ``width`` and ``height``. Raises
    :class:`InputError`: one sentence that names the file, and what is absent or wrong.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"There is no file {path}.")
    try:
        text = path.read_text(encoding="utf-8-sig").strip()
    except (UnicodeDecodeError, OSError) as error:
        raise InputError(f"{path} cannot be read as text: {error}.") from error
    if text.startswith("<"):
        root = _xml(path, text)
        if root.tag == "opencv_storage":
            return _from_fields(path, _xml_fields(path, root))
        return _from_visp(path, root)
    if text.startswith("%YAML") or "!!opencv-matrix" in text:
        return _from_fields(path, read_opencv_storage(path))
    try:
        content = json.loads(text) if text.startswith(("{", "[")) else yaml.safe_load(text)
    except (json.JSONDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{path} is neither JSON nor YAML: {' '.join(str(error).split())}.") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected the names K, distortion, width and height with their values.")
    return _from_fields(path, content)


def _from_fields(path: Path, fields: Mapping[str, Any]) -> Camera:
    model = str(fields.get("distortion_model", "")).lower()
    if model not in DISTORTION_MODELS:
        raise InputError(
            f"{path}: the distortion model {model!r} is not supported; expected plumb_bob or rational_polynomial."
        )
    size = []
    for names in (WIDTH, HEIGHT):
        name, value = _first(fields, names)
        if name is None:
            raise InputError(f"{path}: the image size is absent; expected {' or '.join(names[:2])} in pixels.")
        if isinstance(value, bool) or not isinstance(value, int | float) or value != int(value):
            raise InputError(f"{path}: {name} must be a number of pixels, not {value!r}.")
        size.append(int(value))
    name, value = _first(fields, MATRIX)
    if name is not None:
        K = _numbers(path, name, value)
        if K.size != 9:
            raise InputError(f"{path}: {name} must hold 9 numbers (3 x 3), but it holds {K.size}.")
        K = K.reshape(3, 3)
    elif all(one in fields for one in FOCAL):
        fx, fy, cx, cy = (_numbers(path, one, [fields[one]])[0] for one in FOCAL)
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    else:
        raise InputError(f"{path}: the camera matrix is absent; expected K, camera_matrix, or fx, fy, cx and cy.")
    name, value = _first(fields, DISTORTION)
    distortion = np.zeros(0) if name is None or value is None else _numbers(path, name, value)
    return _camera(path, K, distortion, size)


def _first(fields: Mapping[str, Any], names: tuple[str, ...]) -> tuple[str | None, Any]:
    name = next((one for one in names if one in fields), None)
    return name, None if name is None else fields[name]


def _numbers(path: Path, name: str, value: Any) -> Float[np.ndarray, " n"]:
    """A list, nested or flat, an array, or a mapping with ``data`` (ROS, OpenCV's JSON), row by row."""
    if isinstance(value, Mapping):
        value = value.get("data")
    try:
        numbers = np.array(value, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: {name} must hold numbers, row by row.") from error
    if not np.isfinite(numbers).all():
        raise InputError(f"{path}: {name} holds a value that is not a finite number.")
    return numbers


def _camera(path: Path, K: np.ndarray, distortion: np.ndarray, size: list[int]) -> Camera:
    try:
        return Camera(K, distortion, *size)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _xml(path: Path, text: str) -> ElementTree.Element:
    if "<!ENTITY" in text:
        raise InputError(f"{path}: XML with entities of its own is not read.")
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"{path} is not XML: {error}.") from error


def _xml_fields(path: Path, root: ElementTree.Element) -> dict[str, Any]:
    """The nodes of OpenCV's XML: matrices as their numbers, row by row, and single values."""
    fields: dict[str, Any] = {}
    for node in root:
        data = node.find("data")
        words = ((data if data is not None else node).text or "").split()
        if data is not None or len(words) == 1:
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                if data is not None:
                    raise InputError(f"{path}: {node.tag} must hold numbers, row by row.") from None
                numbers = words
            fields[node.tag] = numbers if data is not None else numbers[0]
    return fields


def _from_visp(path: Path, root: ElementTree.Element) -> Camera:
    """ViSP's ``<root><camera>...<model>``; the model with distortion where both are there."""
    cameras = root.findall("camera")
    if len(cameras) != 1:
        raise InputError(f"{path}: expected OpenCV's or ViSP's XML with one camera, found {len(cameras)} cameras.")
    models = {(model.findtext("type") or "").strip(): model for model in cameras[0].findall("model")}
    model = next((models[name] for name in VISP if name in models), None)
    if model is None:
        raise InputError(f"{path}: expected a model {' or '.join(VISP)}, found {', '.join(models) or 'none'}.")
    values = {}
    for name in ("image_width", "image_height", "px", "py", "u0", "v0", "kud"):
        node = cameras[0] if name.startswith("image") else model
        text = node.findtext(name, default="0" if name == "kud" else None)
        if text is None:
            raise InputError(f"{path}: the camera has no <{name}>.")
        values[name] = _numbers(path, name, [text.strip()])[0]
    K = np.array([[values["px"], 0, values["u0"]], [0, values["py"], values["v0"]], [0, 0, 1.0]])
    size = [int(values[name]) for name in ("image_width", "image_height")]
    return _camera(path, K, np.array([values["kud"]]), size)
