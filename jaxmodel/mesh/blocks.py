"""Array work in blocks small enough for the processor's cache, a thread for each core, the results in order."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Part = TypeVar("Part")


def in_blocks(count: int, size: int, work: Callable[[slice], Part]) -> list[Part]:
    """``work`` on each run of ``size`` of ``count`` rows; NumPy lets the threads work side by side.

    The result does not depend on the number of cores, as long as no block writes what another reads.
    """
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return list(threads.map(work, (slice(start, min(start + size, count)) for start in range(0, count, size))))
