"""Words of a study's report, and faults of its folder."""

from pathlib import Path

import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.run.config import Right
from jaxmodel.run.study_report import draw_study, read_table, right_means


def test_what_right_means_in_words() -> None:
    assert right_means(unstructure(Right())) == (
        "rotation within 5 degrees, source's centroid within 3 % of the diagonal of the source's box"
    )
    assert right_means(unstructure(Right(tolerance=0.005))).endswith("within 0.005 (unit of the data)")


def test_missing_and_broken_tables_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"results\.parquet: not readable as a table"):
        read_table(tmp_path / "results.parquet")
    (tmp_path / "results.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(InputError, match=r"results\.parquet: not readable as a table"):
        read_table(tmp_path / "results.parquet")


def test_a_folder_without_results_is_not_drawn(tmp_path: Path) -> None:
    with RunDir.create(tmp_path / "out", {}) as folder, pytest.raises(InputError, match="not readable as a table"):
        draw_study(folder, {}, "title", lambda summary, command: [], lambda summary, rows, iterations: [])
    assert not (tmp_path / "out" / "report.html").exists()
