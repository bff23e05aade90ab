"""Colours of segments: far apart in hue, free-form parts pale."""

import colorsys

import numpy as np
from jaxtyping import Int, UInt8

from jaxmodel.mesh.segmentation import Segmentation

_GOLDEN = 0.6180339887498949


def segment_colours(found: Segmentation) -> UInt8[np.ndarray, "s 3"]:
    """A colour for each segment: hues by the golden ratio, so that neighbours in number are far apart."""
    colours = []
    for number, primitive in enumerate(found.primitives):
        pale = primitive.kind == "free-form"
        hue = (0.58 + number * _GOLDEN) % 1.0
        colours.append(colorsys.hsv_to_rgb(hue, 0.2 if pale else 0.65, 0.85 if number % 2 else 0.95))
    return np.round(255 * np.array(colours).reshape(-1, 3)).astype(np.uint8)


def face_colours(found: Segmentation) -> UInt8[np.ndarray, "m 3"]:
    """The colour of each triangle's segment."""
    labels: Int[np.ndarray, " m"] = found.labels
    return segment_colours(found)[labels]


def number_colours(numbers: Int[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """A colour for each number, as those of flat segments."""
    hues = (0.58 + numbers * _GOLDEN) % 1.0
    colours = [
        colorsys.hsv_to_rgb(hue, 0.65, 0.85 if number % 2 else 0.95) for hue, number in zip(hues, numbers, strict=True)
    ]
    return np.round(255 * np.array(colours).reshape(-1, 3)).astype(np.uint8)
