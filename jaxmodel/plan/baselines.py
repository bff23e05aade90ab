"""Sequences of views that use no utility: what a planner is measured against.

Random and evenly spread views on an observation sphere, fixed before the first scan, and the simple area-factor
planner, which looks where most of the unseen is. Poses are ``T_world_sensor``, looking at the sphere's centre.
"""

from enum import IntEnum
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.errors import InputError
from jaxmodel.scan.virtual_scanner import look_at

UNKNOWN, EMPTY, OCCUPIED, OCCLUDED, OCCLUSION_PLANE, BORDER = range(6)
"""Columns of an array of counts: what a view's rays first hit, by label; EMPTY are the rays that hit nothing."""


class ObservationSphere(eqx.Module):
    """The sphere a sensor moves on, world frame and unit: from ``lowest_elevation_deg`` above the xy plane upwards.

    -90 is the whole sphere. Raises :class:`InputError` for a radius that is not positive or an elevation outside
    [-90, 90).
    """

    centre: Float[np.ndarray, "3"]
    radius: float | int
    lowest_elevation_deg: float | int = -90.0

    def __check_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0) or not np.isfinite(self.centre).all():
            raise InputError(f"An observation sphere needs a finite centre and a positive radius, got {self.radius}.")
        if not -90 <= self.lowest_elevation_deg < 90:
            raise InputError(f"lowest_elevation_deg: expected in [-90, 90), got {self.lowest_elevation_deg}.")

    @property
    def lowest_sine(self) -> float:
        """Least height of a direction of the sphere, in radii."""
        return float(np.sin(np.deg2rad(self.lowest_elevation_deg)))

    def poses(self, directions: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 4 4"]:
        """``T_world_sensor`` of sensors in unit ``directions`` from the centre, looking at it."""
        poses = [look_at(self.centre + self.radius * direction, self.centre) for direction in directions]
        return np.stack(poses) if poses else np.zeros((0, 4, 4))


def random_views(sphere: ObservationSphere, key: jax.Array, count: int) -> Float[np.ndarray, "v 4 4"]:
    """``count`` views drawn evenly by area from the sphere; view i is the same whatever ``count`` is."""
    _check(count)
    keys = jax.vmap(lambda i: jax.random.fold_in(key, i))(np.arange(count))
    draws = np.asarray(jax.vmap(lambda k: jax.random.uniform(k, (2,)))(keys), dtype=np.float64)
    return sphere.poses(
        _directions(sphere.lowest_sine + (1 - sphere.lowest_sine) * draws[:, 0], 2 * np.pi * draws[:, 1])
    )


def uniform_views(
    sphere: ObservationSphere, count: int, first: Float[np.ndarray, "3"] | None = None
) -> Float[np.ndarray, "v 4 4"]:
    """``count`` views spread evenly over the sphere, ordered so that every beginning of the sequence is spread too.

    The directions are a Fibonacci spiral; the order is farthest first (Gonzalez, Theoretical Computer Science 38,
    1985): each next view is the one farthest from those before, so a beginning leaves no gap wider than twice what
    the best choice of as many of these directions would. The first is the one nearest to the direction ``first``,
    the spiral's highest unless given.
    """
    _check(count)
    height = 1 - (np.arange(count) + 0.5) / count * (1 - sphere.lowest_sine)
    directions = _directions(height, np.arange(count) * np.pi * (3 - np.sqrt(5.0)))
    return sphere.poses(directions[farthest_first(directions, first)])


def farthest_first(
    directions: Float[np.ndarray, "v 3"], first: Float[np.ndarray, "3"] | None = None
) -> Int[np.ndarray, " v"]:
    """An order of unit ``directions`` in which each is the farthest from all before it; ties go to the lower index."""
    chosen = 0 if first is None else int(np.argmax(directions @ first))
    order = [chosen]
    gap = np.full(len(directions), np.inf)
    for _ in range(len(directions) - 1):
        gap = np.minimum(gap, np.linalg.norm(directions - directions[chosen], axis=1))
        gap[chosen] = -1.0
        chosen = int(np.argmax(gap))
        order.append(chosen)
    return np.array(order)


class ChoiceOutcome(IntEnum):
    """How a choice among candidate views ended; each value has a ``sentence``."""

    CHOSEN = 0
    NOTHING_UNSEEN = 1
    NO_OVERLAP = 2
    NO_VIEW = 3

    @property
    def sentence(self) -> str:
        return {
            ChoiceOutcome.CHOSEN: "the view with most of the unseen was chosen",
            ChoiceOutcome.NOTHING_UNSEEN: "no allowed view sees anything that was not seen before",
            ChoiceOutcome.NO_OVERLAP: "no allowed view overlaps enough with what was seen before",
            ChoiceOutcome.NO_VIEW: "no view is allowed",
        }[self]


class Choice(NamedTuple):
    """The chosen candidate ``view`` (-1 unless the outcome is CHOSEN) and its ``score``."""

    view: int
    score: float
    outcome: ChoiceOutcome


class AreaFactor(eqx.Module):
    """The planner that takes the view onto most of the unseen next to the seen.

    The visibility criterion of Massios and Fisher (A best next view selection algorithm incorporating a quality
    criterion, BMVC 1998) without their quality criterion: the number of rays that first hit an occlusion plane or
    the unknown. No incidence angle, no term for overlap. With ``minimum_overlap`` it may only choose among views
    whose overlap is at least that: the share of occupied and border rays among the rays that hit anything.
    """

    minimum_overlap: float | int | None = None

    def __check_init__(self) -> None:
        if self.minimum_overlap is not None and not 0 <= self.minimum_overlap <= 1:
            raise InputError(f"minimum_overlap: expected between 0 and 1, got {self.minimum_overlap}.")

    def scores(self, counts: Float[np.ndarray, "v 6"] | Int[np.ndarray, "v 6"]) -> Float[np.ndarray, " v"]:
        """Unseen rays of each candidate view, from its ``counts`` by label (columns as in this module)."""
        return np.asarray(counts[:, UNKNOWN] + counts[:, OCCLUSION_PLANE], dtype=np.float64)

    def choose(
        self, counts: Float[np.ndarray, "v 6"] | Int[np.ndarray, "v 6"], allowed: Bool[np.ndarray, " v"] | None = None
    ) -> Choice:
        """The allowed view of highest score, the first of several equal ones; the outcome says when there is none."""
        usable = np.ones(len(counts), dtype=bool) if allowed is None else allowed
        if not usable.any():
            return Choice(-1, 0.0, ChoiceOutcome.NO_VIEW)
        if self.minimum_overlap is not None:
            usable = usable & overlaps_enough(counts, self.minimum_overlap)
            if not usable.any():
                return Choice(-1, 0.0, ChoiceOutcome.NO_OVERLAP)
        scores = np.where(usable, self.scores(counts), -np.inf)
        best = int(np.argmax(scores))
        if not scores[best] > 0:
            return Choice(-1, 0.0, ChoiceOutcome.NOTHING_UNSEEN)
        return Choice(best, float(scores[best]), ChoiceOutcome.CHOSEN)


def overlap(counts: Float[np.ndarray, "v 6"] | Int[np.ndarray, "v 6"]) -> Float[np.ndarray, " v"]:
    """Share of occupied and border rays among a view's rays that hit anything; 0 for a view that hits nothing."""
    counts = np.asarray(counts, dtype=np.float64)
    hits = counts.sum(axis=1) - counts[:, EMPTY]
    return (counts[:, OCCUPIED] + counts[:, BORDER]) / np.where(hits > 0, hits, 1.0)


def overlaps_enough(
    counts: Float[np.ndarray, "v 6"] | Int[np.ndarray, "v 6"], minimum_overlap: float
) -> Bool[np.ndarray, " v"]:
    """Views whose :func:`overlap` is at least ``minimum_overlap``: the constraint any planner can be held to."""
    return overlap(counts) >= minimum_overlap


def _directions(height: Float[np.ndarray, " v"], angle: Float[np.ndarray, " v"]) -> Float[np.ndarray, "v 3"]:
    """Unit vectors of given height and angle around z."""
    width = np.sqrt(np.maximum(1 - height**2, 0.0))
    return np.stack([width * np.cos(angle), width * np.sin(angle), height], axis=1)


def _check(count: int) -> None:
    if count < 1:
        raise InputError(f"count: expected at least 1 view, got {count}.")
