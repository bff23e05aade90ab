"""What a person sees: tables and sentences on standard output, faults and progress on standard error."""

import os
import sys
from collections.abc import Sequence
from types import TracebackType
from typing import Any


def write(text: str) -> None:
    """One line on standard output."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def complain(error: BaseException) -> None:
    """One sentence on standard error; the traceback only with ``JAXMODEL_DEBUG=1``."""
    if os.environ.get("JAXMODEL_DEBUG") == "1":
        import traceback

        traceback.print_exception(error)
    sentence = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    sys.stderr.write(f"jaxmodel: {sentence}.\n")


def write_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on standard output, as wide as the terminal, or 120 columns where there is none."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for number, column in enumerate(columns):
        table.add_column(column, overflow="fold", no_wrap=number == 0 and all(len(row[0]) <= 24 for row in rows))
    for row in rows:
        table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else 120, markup=False).print(table)


class Progress:
    """A progress bar with time left, drawn only when a person is watching standard error.

    ``unit`` is what is counted, for its number per second; without one that is not shown.
    """

    def __init__(self, unit: str = "starts") -> None:
        self._unit = unit
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> "Progress":
        if sys.stderr.isatty():
            from rich import progress
            from rich.console import Console

            self._bar = progress.Progress(
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.MofNCompleteColumn(),
                progress.TextColumn("{task.fields[rate]}"),
                progress.TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=True,
            )
            self._bar.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.stop()

    def begin(self, what: str, total: int) -> None:
        """Start counting towards ``total`` items."""
        if self._bar is not None:
            self._task = self._bar.add_task(what, total=total, rate="")

    def describe(self, what: str) -> None:
        """Say what is being done now."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=what)

    def advance(self, items: int) -> None:
        """Count ``items`` more as done."""
        if self._bar is not None and self._task is not None:
            self._bar.advance(self._task, items)
            speed = self._bar.tasks[0].speed
            self._bar.update(self._task, rate=f"{speed:.0f} {self._unit}/s" if speed and self._unit else "")
