"""Point files of H. Hoppe's surface reconstruction thesis (1994): lines ``p x y z``."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError

_SKIPPED = ("#", "d", "g", "s")  # comments, density, noise and sampling notes


def read_hoppe(text: str, path: Path) -> Float[np.ndarray, "n 3"]:
    """The points of a ``.pts`` file; lines starting ``#``, ``d``, ``g``, ``s`` are ignored.

    Raises :class:`InputError` naming ``path`` and the line that is neither.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith(_SKIPPED):
            continue
        try:
            if words[0] != "p" or len(words) != 4:
                raise ValueError
            rows.append([float(word) for word in words[1:]])
        except ValueError:
            raise InputError(f"{path}, line {number}: expected 'p x y z', found {line[:60]!r}.") from None
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
