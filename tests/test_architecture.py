"""The house as a law: folders are the data flow, and imports go one way along it."""

import ast
from pathlib import Path
from typing import NamedTuple

import pytest

PROJECT_ROOT = Path(__file__).resolve().parent.parent
PACKAGE = PROJECT_ROOT / "jaxmodel"

# In the order of the data flow: a stage sees the stages before it.
STAGES = ("geometry", "scan", "lanes", "control_points", "register", "mesh", "plan", "calibrate")
OUTER = ("io", "run", "view")
LEVEL_FREE = ("errors", "__init__")
SIDE_EFFECTS = ("time", "datetime", "random", "subprocess", "shutil", "tempfile", "logging", "socket", "threading")

MODULES = sorted(PACKAGE.rglob("*.py"))


class Imported(NamedTuple):
    """One imported module: its dotted name, the line, and whether it waits inside a function."""

    name: str
    line: int
    lazy: bool


def allowed(folder: str, lazy: bool) -> set[str]:
    """Top-level names of jaxmodel that a module of ``folder`` may import."""
    free = set(LEVEL_FREE)
    if folder in STAGES:
        return free | set(STAGES[: STAGES.index(folder) + 1]) | ({"io"} if lazy else set())
    if folder == "io":
        return free | {"io", *STAGES}
    if folder == "view":
        return free | {"view", "io", *STAGES}
    return free | {*STAGES, *OUTER}  # run, and the package itself


def imports(source: str) -> list[Imported]:
    """Every import of a source text, those inside functions marked as lazy."""
    found: list[Imported] = []

    def visit(node: ast.AST, lazy: bool) -> None:
        if isinstance(node, ast.Import):
            found.extend(Imported(alias.name, node.lineno, lazy) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            # `from jaxmodel import scan` names a folder, `from jaxmodel.scan import cloud` is in one already.
            names = [f"jaxmodel.{alias.name}" for alias in node.names] if node.module == "jaxmodel" else [node.module]
            found.extend(Imported(name, node.lineno, lazy) for name in names)
        lazy = lazy or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            visit(child, lazy)

    visit(ast.parse(source), False)
    return found


def wrong_imports(folder: str, source: str) -> list[str]:
    """A sentence for each import in ``source`` that a module of ``folder`` may not have."""
    sentences = []
    for name, line, lazy in imports(source):
        first, *rest = name.split(".")
        if first == "jaxmodel" and rest and not rest[0].startswith("__") and rest[0] not in allowed(folder, lazy):
            sentences.append(f"line {line}: {folder} imports {name}, which is later in the data flow")
        if folder in STAGES and first in SIDE_EFFECTS:
            sentences.append(f"line {line}: {folder} imports {name}, but a stage is pure array code")
    return sentences


def folder_of(module: Path) -> str:
    parts = module.relative_to(PACKAGE).with_suffix("").parts
    return parts[0] if parts[0] != "__init__" else "jaxmodel"


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_go_one_way_along_the_data_flow(module: Path) -> None:
    assert wrong_imports(folder_of(module), module.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("folder", "source", "is_wrong"),
    [
        ("scan", "from jaxmodel.geometry.se3 import log", False),
        ("scan", "from jaxmodel.scan.cloud import Cloud\nfrom jaxmodel.errors import InputError", False),
        ("geometry", "from jaxmodel.scan.cloud import Cloud", True),
        ("geometry", "from jaxmodel import scan", True),
        ("control_points", "import jaxmodel.register.icp", True),
        ("register", "from jaxmodel.io.strict_yaml import load", True),
        ("register", "def named():\n    from jaxmodel.io.strict_yaml import load", False),
        ("register", "def f():\n    from jaxmodel.run.config import Engine", True),
        ("register", "class A:\n    from jaxmodel.view import figures", True),
        ("register", "import time", True),
        ("io", "from jaxmodel.scan.range_image import RangeImage", False),
        ("io", "from jaxmodel.run.config import Engine", True),
        ("view", "from jaxmodel.run.config import Engine", True),
        ("run", "from jaxmodel.view.figures import draw\nimport time", False),
    ],
)
def test_the_check_itself(folder: str, source: str, is_wrong: bool) -> None:
    assert bool(wrong_imports(folder, source)) == is_wrong


def test_folders_are_those_of_the_plan() -> None:
    known = {*STAGES, *OUTER, "errors", "lanes", "__init__", "__main__", "configs"}
    present = {path.stem for path in PACKAGE.iterdir() if path.name != "__pycache__" and not path.name.startswith(".")}
    assert present <= known
    assert {"geometry", "scan", "control_points", "register", "io", "run", "view"} <= present


def test_no_module_is_a_drawer_for_everything() -> None:
    drawers = {"utils", "util", "common", "helpers", "helper", "misc", "base", "tools"}
    assert [module for module in MODULES if drawers & set(module.relative_to(PACKAGE).with_suffix("").parts)] == []


def test_tests_mirror_the_package() -> None:
    folders = {path.parent.name for path in (PROJECT_ROOT / "tests").glob("*/test_*.py")}
    assert folders <= {*STAGES, *OUTER, "experiments"}
