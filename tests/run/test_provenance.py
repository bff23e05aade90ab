"""A run may only be continued as what it was."""

from pathlib import Path
from typing import Any

import pytest

from jaxmodel.errors import InputError
from jaxmodel.run.provenance import check_same, hash_files, manifest


def about(**changes: Any) -> dict[str, Any]:
    resolved = {"seed": 0, "engine": {"chunk": 10}, "pairs": ["a", "b"], **changes}
    return manifest("convergence", resolved, {"a.ply": "12"}, "jaxmodel run a.yaml")


def test_the_same_run_goes_on() -> None:
    check_same(about(), about(), Path("out"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 1}, "seed was 0 and is 1 now"),
        ({"engine": {"chunk": 20}}, "engine.chunk was 10 and is 20 now"),
        ({"pairs": ["a", "c"]}, "pairs.1 was 'b' and is 'c' now"),
        ({"pairs": ["a"]}, "pairs was"),
        ({"new": 3}, "new was None and is 3 now"),
    ],
)
def test_another_configuration_is_refused_by_its_first_difference(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        check_same(about(), about(**change), Path("out"))
    assert words in str(caught.value) and str(caught.value).startswith("out: cannot be resumed")


def test_changed_inputs_and_versions_are_refused() -> None:
    old = about()
    with pytest.raises(InputError, match=r"the input a\.ply has changed since"):
        check_same({**old, "inputs": {"a.ply": "13"}}, about(), Path("out"))
    with pytest.raises(InputError, match=r"it was begun with jax 0\.0\.1"):
        check_same({**old, "versions": {**old["versions"], "jax": "0.0.1"}}, about(), Path("out"))


def test_hashes_follow_the_content(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    (tmp_path / "b").write_bytes(b"1")
    (tmp_path / "c").write_bytes(b"2")
    hashes = list(hash_files([tmp_path / name for name in "abc"]).values())
    assert hashes[0] == hashes[1] != hashes[2]
    with pytest.raises(InputError, match="absent"):
        hash_files([tmp_path / "absent"])
