"""The built-in test objects by name: every experiment can run on them, with no data file.

Object units: centred on the origin, the longest side of the bounding box 1. Two families, as in the thesis (§2.9).
"""

from collections.abc import Callable

from jaxmodel.errors import InputError
from jaxmodel.scan.free_form_objects import boulder, gourd, torso
from jaxmodel.scan.structured_objects import block_curved, block_steps, valve, y_pipe
from jaxmodel.scan.triangle_mesh import ObjectMesh

__all__ = ["FREE_FORM", "OBJECTS", "STRUCTURED", "ObjectMesh", "object_mesh"]

STRUCTURED: dict[str, Callable[[], ObjectMesh]] = {
    "block_steps": block_steps,
    "block_curved": block_curved,
    "y_pipe": y_pipe,
    "valve": valve,
}
FREE_FORM: dict[str, Callable[[], ObjectMesh]] = {"boulder": boulder, "gourd": gourd, "torso": torso}
OBJECTS: dict[str, Callable[[], ObjectMesh]] = {**STRUCTURED, **FREE_FORM}


def object_mesh(name: str) -> ObjectMesh:
    """The built-in object ``name``. Raises :class:`InputError` listing the names when there is none."""
    if name not in OBJECTS:
        raise InputError(f"There is no built-in object {name!r}; there are {', '.join(OBJECTS)}.")
    return OBJECTS[name]()
