"""From a study's YAML to its trials: labels, draws of the noise, starts that do not depend on the number of points."""

import dataclasses

import numpy as np
import pytest

from jaxmodel.control_points import Contours, Subsample, Vertices
from jaxmodel.run.chapter2.trials import Group, StudyConfig, Trial, placed_pairs, plain_trials, starts_of
from jaxmodel.run.config import ObjectScans, PlausibleStarts
from jaxmodel.scan.sensor import Sensor

SCANS = ObjectScans(("boulder",), turns_deg=(0.0, 90.0), sensor=Sensor(width=50, height=50))
GROUP = Group(SCANS, (Subsample(), Vertices()), "BOULDER")
CONFIG = StudyConfig(
    groups=(GROUP,), counts=(50, 30), draws=2, compared=("subsample", "vertices"), starts=PlausibleStarts(count=3)
)


def labels(*kinds: Contours | Vertices | Subsample) -> tuple[str, ...]:
    placed = placed_pairs(dataclasses.replace(CONFIG, draws=1))[0]
    return Trial(placed.pair, kinds, (50, 50), np.eye(4)[None]).labels


def test_kinds_are_told_apart_by_what_differs_in_them() -> None:
    assert labels(Contours(), Vertices()) == ("contours", "vertices")
    everything = Contours(labels=("crease", "depth", "border"))
    assert labels(Contours(), everything, Vertices()) == (
        "contours crease",
        "contours crease+depth+border",
        "vertices",
    )


def test_every_draw_is_another_noise_on_the_same_view() -> None:
    placed = placed_pairs(CONFIG)
    assert [(p.draw, p.pair.name) for p in placed] == [
        (draw, name) for draw in (0, 1) for name in ("boulder000-030", "boulder090-120")
    ]
    first, again = placed[0].pair, placed[2].pair
    np.testing.assert_array_equal(first.T_target_source, again.T_target_source)  # pyright: ignore[reportArgumentType]
    assert not np.array_equal(first.target.points, again.target.points, equal_nan=True)


def test_plain_trials_give_every_count_of_a_pair_the_same_starts() -> None:
    trials = plain_trials(CONFIG)
    assert [trial.counts for trial in trials] == [(50, 50), (30, 30)] * 4
    assert all(trial.stands_for == "BOULDER" and len(trial.starts) == 3 for trial in trials)
    np.testing.assert_array_equal(trials[0].starts, trials[1].starts)
    assert not np.allclose(trials[0].starts, trials[2].starts)


def test_starts_depend_on_the_seed_and_the_number() -> None:
    pair = placed_pairs(dataclasses.replace(CONFIG, draws=1))[0].pair
    first = starts_of(CONFIG, pair, 0)
    assert not np.allclose(first, starts_of(CONFIG, pair, 1))
    assert not np.allclose(first, starts_of(dataclasses.replace(CONFIG, seed=1), pair, 0))
    more = dataclasses.replace(CONFIG, starts=PlausibleStarts(count=9))
    np.testing.assert_array_equal(first, starts_of(more, pair, 0)[:3])


def test_a_group_without_kinds_is_refused() -> None:
    with pytest.raises(ValueError, match="control_points is empty"):
        Group(SCANS, ())
