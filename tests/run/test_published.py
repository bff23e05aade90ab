"""The table beside the thesis: both ways of counting, and honest blanks."""

from typing import Any

from jaxmodel.run.published import COLUMNS, published_lines, published_rows


def case(pair: str, kind: str, count: int, family: str = "free_form") -> dict[str, Any]:
    return {"pair": pair, "family": family, "control_points": kind, "success": {"count": count, "total": 100}}


CASES = [
    case("a", "subsample", 30),
    case("a", "vertices", 0),
    case("b", "subsample", 0),
    case("b", "vertices", 0),
    case("c", "subsample", 0, "unknown"),
    {"pair": "d", "family": "free_form", "control_points": "subsample"},
]


def test_pairs_without_any_success_count_in_one_way_only() -> None:
    free_form = next(row for row in published_rows(CASES) if row["what"].startswith("free-form"))
    assert free_form["published"] == {"contours": 0.15, "vertices": 0.14}
    assert free_form["ours"]["subsample"]["all_pairs"] == {"pairs": 2, "count": 30, "total": 200, "rate": 0.15}
    assert free_form["ours"]["subsample"]["pairs_with_success"]["rate"] == 0.3
    assert free_form["ours"]["vertices"]["pairs_with_success"]["rate"] == 0.0


def test_what_was_not_run_says_so() -> None:
    rows = published_rows(CASES)
    assert [row["ours"] == {} for row in rows] == [False, True, True]
    lines = published_lines(rows, "jaxmodel run x")
    assert all(len(line) == len(COLUMNS) and line[-1] == "jaxmodel run x" for line in lines)
    assert lines[1][1:4] == ("contours 20 %, vertices 19 %", "not run", "not run")
    assert lines[2][1] == "contours 3.5 %"


def test_a_family_where_nothing_converged_has_no_rate_of_the_second_kind() -> None:
    rows = published_rows([case("a", "subsample", 0, "structured")])
    assert published_lines(rows, "")[1][2:4] == ("subsample 0 % (0 of 100, 1 pair)", "subsample none")
