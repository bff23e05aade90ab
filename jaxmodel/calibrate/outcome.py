"""How a calibration ended, and what its motions determine."""

from enum import IntEnum


class Outcome(IntEnum):
    """Each value has a ``sentence``."""

    SOLVED = 0
    TRANSLATION_ALONG_AXIS = 1
    ROTATION_ONLY = 2
    ROTATION_ABOUT_AXIS = 3
    SEVERAL_ANSWERS = 4
    SCALE_TIED = 5
    NO_MOTION = 6
    NOT_FINITE = 7
    NOT_CONVERGED = 8

    @property
    def sentence(self) -> str:
        return {
            Outcome.SOLVED: "the motions determine the rotation and the translation",
            Outcome.TRANSLATION_ALONG_AXIS: "all rotations turn about one axis: the rotation is determined, the "
            "translation only up to a shift along that axis",
            Outcome.ROTATION_ONLY: "the motions are pure translations: they determine the rotation, and nothing of the "
            "translation",
            Outcome.ROTATION_ABOUT_AXIS: "the motions leave the rotation free about one direction",
            Outcome.SEVERAL_ANSWERS: "rotations by 180 degrees leave several answers that fit equally well",
            Outcome.SCALE_TIED: "the scale and the translation are only determined up to a common factor: the hand "
            "turned about a fixed point",
            Outcome.NO_MOTION: "no motion stands out of the noise, so nothing is determined",
            Outcome.NOT_FINITE: "a motion that carries weight is not finite, or a weight is negative",
            Outcome.NOT_CONVERGED: "the iterations ended before the stopping rule was met",
        }[self]

    @property
    def usable(self) -> bool:
        """Whether X is the one answer: rotation, translation and scale determined."""
        return self is Outcome.SOLVED
