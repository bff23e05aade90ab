"""OpenCV's FileStorage in YAML, read without OpenCV: matrices, numbers and text."""

from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Shaped

from jaxmodel.errors import InputError

TYPES = {"d": np.float64, "f": np.float32, "i": np.int32, "u": np.uint8, "w": np.uint16, "s": np.int16, "c": np.int8}


class _Loader(yaml.SafeLoader):
    """YAML with OpenCV's matrix tag; nothing else that a file could ask for."""


def _matrix(loader: yaml.SafeLoader, node: yaml.Node) -> Shaped[np.ndarray, "*shape"]:
    if not isinstance(node, yaml.MappingNode):
        raise ValueError("an opencv-matrix must be a mapping")
    fields = loader.construct_mapping(node, deep=True)
    kind = str(fields["dt"])
    rows, columns, values = int(fields["rows"]), int(fields["cols"]), fields["data"]
    channels = int(kind[:-1]) if len(kind) > 1 else 1
    shape = (rows, columns) if channels == 1 else (rows, columns, channels)
    numbers = [float(str(v).replace(".N", "n").replace(".I", "i")) for v in values]  # OpenCV writes .Nan and .Inf
    return np.array(numbers, dtype=TYPES[kind[-1]]).reshape(shape)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def read_opencv_storage(path: str | Path) -> dict[str, object]:
    """The nodes of a ``.yml`` FileStorage by name: NumPy arrays for matrices, plain Python values for the rest.

    Raises :class:`InputError` naming the file and what is wrong with it.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"There is no file {path}.")
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        # the directive "%YAML:1.0" is not YAML's own form of it
        body = "\n".join("" if line.startswith("%YAML") else line for line in lines)
        content = yaml.load(body, Loader=_Loader)
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is not an OpenCV FileStorage in YAML: {error}.") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected named nodes of an OpenCV FileStorage.")
    return {str(name): value for name, value in content.items()}
