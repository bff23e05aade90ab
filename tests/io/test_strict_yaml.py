"""Strict YAML: each wrong file gets its own sentence, and right ones come back as they were."""

import dataclasses
from pathlib import Path
from typing import Literal

import equinox as eqx
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.strict_yaml import override, parse_yaml, read_yaml, structure, unstructure

BAD = Path(__file__).resolve().parents[1] / "bad_configs"


@dataclasses.dataclass(frozen=True)
class Grid:
    kind: Literal["grid"] = "grid"
    count: int = 10
    scale: float = 1.0

    def __post_init__(self) -> None:
        if self.count < 0:
            raise ValueError(f"count is {self.count}, expected 0 or more")


class Draw(eqx.Module):
    kind: Literal["draw"] = "draw"
    limit: float = 0.5
    steps: int = eqx.field(static=True, default=3)

    def __check_init__(self) -> None:
        if self.steps < 1:
            raise ValueError(f"steps is {self.steps}, expected at least 1")


@dataclasses.dataclass(frozen=True)
class Config:
    name: str
    nodes: tuple[Grid | Draw, ...] = ()
    method: str | Draw = "plain"
    pairs: Literal["all"] | tuple[tuple[str, str], ...] = "all"
    limit: float | None = None
    exact: bool = False
    inner: Grid = dataclasses.field(default_factory=Grid)


def fault(raw: dict) -> str:
    with pytest.raises(InputError) as caught:
        structure(raw, Config, "a.yaml")
    sentence = str(caught.value)
    assert sentence.startswith("a.yaml: ") and "\n" not in sentence
    return sentence


def test_round_trip_keeps_every_value() -> None:
    config = Config(
        "x", (Grid(count=4), Draw(steps=9)), Draw(limit=2.0), (("a", "b"), ("c", "d")), 0.25, True, Grid(scale=3.0)
    )
    assert structure(unstructure(config), Config, "a.yaml") == config


def test_whole_numbers_and_exponents_are_real_numbers() -> None:
    assert structure({"name": "x", "limit": 3}, Config, "a").limit == 3.0
    assert structure(parse_yaml("{name: x, limit: 1e-3}", "a"), Config, "a").limit == 1e-3


def test_unknown_key_names_path_and_nearest() -> None:
    assert fault({"name": "x", "inner": {"coutn": 3}}) == "a.yaml: inner.coutn: unknown key, did you mean 'count'?"


def test_unknown_key_goes_before_the_missing_one_it_stands_for() -> None:
    assert fault({"nam": "x"}) == "a.yaml: nam: unknown key, did you mean 'name'?"


def test_unknown_key_like_nothing_lists_the_right_ones() -> None:
    assert "expected one of: kind, count, scale" in fault({"name": "x", "inner": {"zzz": 3}})


def test_missing_key() -> None:
    assert fault({}) == "a.yaml: name: this key is required and missing"


@pytest.mark.parametrize(
    ("raw", "sentence"),
    [
        ({"inner": {"count": "3"}}, "inner.count: expected a whole number, got the text '3'"),
        ({"inner": {"count": 3.0}}, "inner.count: expected a whole number, got 3.0"),
        ({"inner": {"count": True}}, "inner.count: expected a whole number, got True"),
        ({"inner": {"scale": True}}, "inner.scale: expected a number, got True"),
        ({"inner": {"scale": "wide"}}, "inner.scale: expected a number, got the text 'wide'"),
        ({"inner": {"scale": float("nan")}}, "inner.scale: expected a number, got nan"),
        ({"exact": 1}, "exact: expected true or false, got 1"),
        ({"name": 3}, "name: expected text, got 3"),
        ({"inner": 3}, "inner: expected a mapping with keys kind, count, scale, got 3"),
        ({"nodes": "grid"}, "nodes: expected a list, got the text 'grid'"),
        ({"limit": [1]}, "limit: expected a number or null, got a list"),
        ({"method": 3}, "method: expected a mapping or text, got 3"),
        ({"pairs": [["a"]]}, "pairs.0: expected a list of 2 entries, got 1"),
        ({"pairs": "al"}, "pairs: expected 'all' or a list, got the text 'al'"),
    ],
)
def test_wrong_type_names_path_value_and_expected(raw: dict, sentence: str) -> None:
    assert fault({"name": "x", **raw}) == f"a.yaml: {sentence}"


def test_class_own_check_gets_the_path() -> None:
    assert fault({"name": "x", "nodes": [{"kind": "grid", "count": -1}]}).startswith("a.yaml: nodes.0: count is -1")
    assert fault({"name": "x", "method": {"steps": 0}}).startswith("a.yaml: method: steps is 0")


def test_union_is_told_apart_by_kind() -> None:
    config = structure({"name": "x", "nodes": [{"kind": "draw"}, {"kind": "grid"}]}, Config, "a")
    assert [type(node) for node in config.nodes] == [Draw, Grid]
    assert fault({"name": "x", "nodes": [{"kind": "gird"}]}).endswith("did you mean 'grid'?")
    assert fault({"name": "x", "nodes": [{}]}).endswith("the key 'kind' is missing, expected one of: grid, draw")


def test_override_replaces_by_dotted_path_and_number() -> None:
    raw = {"name": "x", "nodes": [{"kind": "grid", "count": 1}]}
    changed = override(raw, [("nodes.0.count", "5"), ("inner.scale", "2.5"), ("exact", "true")], "a.yaml")
    config = structure(changed, Config, "a.yaml")
    assert config.nodes == (Grid(count=5),) and config.inner.scale == 2.5 and config.exact
    assert raw == {"name": "x", "nodes": [{"kind": "grid", "count": 1}]}


def test_override_of_an_unknown_key_is_the_same_error_as_in_the_file() -> None:
    assert fault(override({"name": "x"}, [("inner.coutn", "3")], "a.yaml")) == fault(
        {"name": "x", "inner": {"coutn": 3}}
    )


@pytest.mark.parametrize("key", ["nodes.7.count", "nodes.first.count", "name.deeper"])
def test_override_of_no_such_place(key: str) -> None:
    with pytest.raises(InputError, match=f"--{key}"):
        override({"name": "x", "nodes": [{}]}, [(key, "1")], "a.yaml")


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("duplicate_key.yaml", "line 3: the key 'seed' is given twice"),
        ("broken.yaml", "not valid YAML"),
        ("empty.yaml", "the file is empty"),
        ("list.yaml", "expected a mapping of keys to values, got a list"),
        ("number_key.yaml", "the key 3 is not text"),
        ("object_tag.yaml", "not valid YAML"),
        ("absent.yaml", "no such file"),
    ],
)
def test_bad_file(file: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read_yaml(BAD / file)
    assert file in str(caught.value) and "\n" not in str(caught.value)


def test_binary_file(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="cannot be read as a text file"):
        read_yaml(tmp_path / "a.yaml")
