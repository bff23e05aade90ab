"""Rows of a study: those without points have the shape of the others, and poses fall back on their starts."""

import numpy as np
import polars

from jaxmodel.control_points import Subsample, Vertices
from jaxmodel.register import Sweep
from jaxmodel.register.outcome import Outcome
from jaxmodel.run.chapter2.study_rows import costs, has_points, no_traces, poses_or, results, without_points
from jaxmodel.run.chapter2.trials import Trial
from jaxmodel.run.config import ObjectScans, Right
from jaxmodel.run.convergence_table import chunk_rows, poses
from jaxmodel.run.pairs import load_pairs, source_extent
from jaxmodel.scan.sensor import Sensor

(PAIR,) = load_pairs(ObjectScans(("boulder",), sensor=Sensor(width=40, height=40)), 0)
assert PAIR.T_target_source is not None
STARTS = np.stack([PAIR.T_target_source] * 3)
TRIAL = Trial(PAIR, (Subsample(), Vertices()), (60, 60), STARTS, stands_for="DRAGON", variant="H-H")


def rows(shifts: list[float]) -> polars.DataFrame:
    """Registrations that end at the truth but for a shift along x, in sizes."""
    _, size = source_extent(PAIR)
    T = STARTS.copy()
    T[:, 0, 3] += size * np.array(shifts)
    n = len(shifts)
    real, whole = np.linspace(0.1, 0.3, n), np.arange(n, dtype=np.int32)
    sweep = Sweep(T, real, real, real, whole, whole, whole, whole, whole * 0 + Outcome.CONVERGED)
    extra = {"points_target": 60, "points_source": 59}
    return chunk_rows(np.arange(n), sweep).with_columns(
        *(polars.lit(value, polars.Int32).alias(name) for name, value in extra.items()),
        extraction=polars.lit(0.5), table=polars.lit(0.1), seconds=polars.lit(0.01), note=polars.lit(""),
    )  # fmt: skip


def test_rows_without_points_have_the_shape_of_the_others() -> None:
    lost, found = without_points(3, "no edge"), rows([0.0, 0.01, 0.5])
    assert lost.schema == found.schema and not has_points(lost) and has_points(found)
    table = results([TRIAL], [[found, lost]], Right())
    assert table["right"].to_list() == [True, True, False] + [False] * 3
    assert table["outcome"].to_list() == ["converged"] * 3 + ["no_control_points"] * 3
    np.testing.assert_allclose(table["translation_error_of_size"][:3], [0.0, 0.01, 0.5], atol=1e-9)
    assert np.isinf(table["rotation_error_deg"][3:].to_numpy()).all()
    assert table["control_points"].to_list() == ["subsample"] * 3 + ["vertices"] * 3
    assert not [name for name in table.columns if name in ("extraction", "table", "seconds", "note")]
    assert set(table["variant"]) == {"H-H"} and set(table["subject"]) == {"boulder"}


def test_a_stated_tolerance_replaces_the_share_of_the_size() -> None:
    _, size = source_extent(PAIR)
    table = results([TRIAL], [[rows([0.0, 0.01, 0.02]), rows([0, 0, 0])]], Right(tolerance=0.015 * size))
    assert table["right"].to_list() == [True, True, False, True, True, True]


def test_poses_that_are_lost_fall_back_on_their_starts() -> None:
    np.testing.assert_array_equal(poses_or(without_points(3, ""), STARTS), STARTS)
    moved = rows([0.1, 0.2, 0.3])
    np.testing.assert_array_equal(poses_or(moved, STARTS), poses(moved))


def test_costs_say_what_each_kind_took_and_why_there_was_none() -> None:
    first, second = costs([TRIAL], [[rows([0, 0, 0]), without_points(3, "no edge")]])
    assert (first["extraction"], first["table"], first["registration"]) == (0.5, 0.1, 0.01)
    assert first["points"] == {"target": 60, "source": 59} and first["variant"] == "H-H"
    assert second["points"] == {"target": 0, "source": 0} and second["note"] == "no edge"


def test_no_traces_is_an_empty_table_with_all_columns() -> None:
    assert len(no_traces()) == 0 and {"iteration", "error", "rotation_error_deg"} <= set(no_traces().columns)
