"""A table of text: what an experiment shows on the terminal and in its report."""

from collections.abc import Sequence
from typing import NamedTuple


class Table(NamedTuple):
    """Cells are text; ``rows`` have as many as ``columns``."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
