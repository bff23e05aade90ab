"""How a registration ended."""

from enum import IntEnum


class Outcome(IntEnum):
    """Each value has a ``sentence``."""

    CONVERGED = 0
    MAX_ITERATIONS = 1
    TOO_FEW_PAIRS = 2
    DEGENERATE = 3
    NOT_FINITE = 4

    @property
    def sentence(self) -> str:
        return {
            Outcome.CONVERGED: "the stopping rule was met",
            Outcome.MAX_ITERATIONS: "the iteration limit was reached before the stopping rule was met",
            Outcome.TOO_FEW_PAIRS: "fewer than four pairs were left after rejection",
            Outcome.DEGENERATE: "the kept pairs do not determine the motion",
            Outcome.NOT_FINITE: "the motion became infinite or not a number",
        }[self]
