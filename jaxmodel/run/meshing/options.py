"""The options of ``jaxmodel mesh`` checked: each belongs to some methods, and has a range."""

import math
from typing import Any, NamedTuple

from jaxmodel.errors import InputError
from jaxmodel.io.structuring import nearest
from jaxmodel.run.meshing.arguments import Mesh

METHODS = ("ball-pivoting", "deformable", "marching-cubes", "poisson")
_BELONGS = {
    "radii": ("ball-pivoting",),
    "thinning": ("ball-pivoting",),
    "closing": ("ball-pivoting",),
    "smallest_part": ("ball-pivoting", "marching-cubes", "poisson"),
    "order": ("deformable",),
    "start": ("deformable",),
    "cell": ("marching-cubes",),
    "depth": ("poisson",),
}
"""Option -> the methods that know it."""


class Options(NamedTuple):
    """A method and the values of its options; those of other methods have their defaults."""

    method: str
    radii: tuple[float, ...] | str = "auto"
    thinning: float | str | None = "auto"
    closing: bool = True
    smallest_part: float = 0.0
    order: int = 5
    start: str = "outside"
    cell: float | str = "auto"
    depth: int | None = None

    def own(self) -> dict[str, Any]:
        """The options that the method knows, by name."""
        return {name: getattr(self, name) for name, methods in _BELONGS.items() if self.method in methods}


def read_options(command: Mesh) -> Options:
    """The options of a command. Raises :class:`InputError`: an unknown method, an option of another, a wrong value."""
    if command.method not in METHODS:
        raise InputError(f"--method {command.method}: no such method, {nearest(command.method, METHODS)}")
    given = {name: getattr(command, name) for name in _BELONGS}
    chosen = {name: value for name, value in given.items() if value is not None and value is not True}
    for name in chosen:
        if command.method not in _BELONGS[name]:
            option = "--no-closing" if name == "closing" else f"--{name.replace('_', '-')}"
            raise InputError(f"{option} belongs to --method {' or '.join(_BELONGS[name])}, not to {command.method}")
    if not command.snap and not command.segment:
        raise InputError("--no-snap needs --segment, whose vertices it leaves in place")
    if command.radii is not None:
        chosen["radii"] = _radii(command.radii)
    if command.thinning is not None:
        chosen["thinning"] = _thinning(command.thinning)
    if command.smallest_part is not None and not 0 <= command.smallest_part < 1:
        raise InputError(f"--smallest-part is {command.smallest_part:g}, expected a share of the area, 0 to below 1")
    if command.cell is not None and not 0 < command.cell < math.inf:
        raise InputError(f"--cell is {command.cell:g}, expected a positive length")
    return Options(command.method, **chosen)


def _radii(text: str) -> tuple[float, ...] | str:
    if text == "auto":
        return text
    radii = [_length(word) for word in text.split(",")]
    if not radii or any(radius is None for radius in radii):
        raise InputError(f"--radii {text}: expected auto, or positive radii with commas between, as 0.5,1,2")
    return tuple(radius for radius in radii if radius is not None)


def _thinning(text: str) -> float | str | None:
    if text in ("auto", "none"):
        return None if text == "none" else text
    distance = _length(text)
    if distance is None:
        raise InputError(f"--thinning {text}: expected auto, none or a positive distance")
    return distance


def _length(word: str) -> float | None:
    """A positive number, or None."""
    try:
        value = float(word)
    except ValueError:
        return None
    return value if 0 < value < math.inf else None
