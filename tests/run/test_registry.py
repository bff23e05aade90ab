"""Every experiment file the project ships is sound, and says what it is."""

from pathlib import Path

import pytest

from jaxmodel.io.strict_yaml import config_files, read_yaml, structure, unstructure
from jaxmodel.run.registry import EXPERIMENTS, load_experiment

SHIPPED = sorted((config_files() / "experiments").glob("*.yaml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_experiments_are_read_and_come_back_the_same(path: Path) -> None:
    assert path.read_text().startswith("# ")
    name, config = load_experiment(read_yaml(path), str(path))
    assert name in EXPERIMENTS
    assert structure(unstructure(config), type(config), "again") == config


def test_the_quickstart_is_there() -> None:
    assert "quickstart" in {path.stem for path in SHIPPED}
