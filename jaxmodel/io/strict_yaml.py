"""Strict YAML: a file becomes a typed object or one sentence saying which key is wrong and what was expected.

Nothing is coerced silently: ``"3"`` is no integer, ``true`` is no number, an unknown key is an error that names the
nearest right one, and a key given twice is refused. An integer is accepted where a real number is expected, and so is
``1e-3``, which YAML 1.1 reads as text.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from jaxmodel.errors import InputError
from jaxmodel.io.structuring import Fault, converter, first_fault, show

T = TypeVar("T")


def config_files() -> Path:
    """Folder with the project's own ``methods/``, ``experiments/`` and ``published/`` files, in a checkout or wheel."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "configs"
    return installed if installed.is_dir() else package.parent / "configs"


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Read one YAML file whose top level is a mapping; a missing, broken or duplicate-key file is an ``InputError``."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a text file ({error})") from None
    return parse_yaml(text, where=str(path))


def parse_yaml(text: str, where: str) -> dict[str, Any]:
    """As ``read_yaml`` for text already in hand; ``where`` names its origin in errors."""
    raw = _parse(text, where)
    if raw is None:
        raise InputError(f"{where}: the file is empty, expected a mapping of keys to values")
    if not isinstance(raw, dict):
        raise InputError(f"{where}: expected a mapping of keys to values, got {show(raw)}")
    return raw


def override(raw: Mapping[str, Any], changes: Iterable[tuple[str, str]], where: str) -> dict[str, Any]:
    """A copy of ``raw`` with dotted keys replaced, e.g. ``("engine.chunk", "100")``.

    Values are parsed as YAML. Intermediate mappings are created, list entries are addressed by number
    (``control_points.0.count``); whether the key
    itself exists is left to ``structure``, so a mistyped one gets the same error as in the file.
    """
    tree = _copy(raw)
    for dotted, text in changes:
        node, keys = tree, dotted.split(".")
        for depth, key in enumerate(keys):
            slot = _slot(node, key, f"{where}: --{dotted}")
            if depth == len(keys) - 1:
                node[slot] = _parse(text, f"{where}: --{dotted}")
            else:
                if isinstance(node, dict) and node.get(slot) is None:
                    node[slot] = {}
                node = node[slot]
    return tree


def structure(raw: Any, cls: type[T], where: str) -> T:
    """Turn a raw tree into an object of ``cls`` (dataclasses and ``eqx.Module`` alike), all the way down.

    Args:
        raw: what ``read_yaml`` gave, with overrides applied.
        cls: the class, or a union of classes told apart by their field ``kind: Literal["..."]``.
        where: the file's name, the start of every error sentence.

    Raises:
        InputError: unknown or missing key, wrong type, or a value the class itself refuses with ``ValueError``.
    """
    try:
        return converter().structure(raw, cls)
    except Exception as error:
        path, sentence = first_fault(error)
        raise InputError(f"{where}: {path + ': ' if path else ''}{sentence}") from error


def unstructure(value: Any) -> Any:
    """The plain tree (mappings, lists, numbers, text) an object was made of, fit for JSON or YAML."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: unstructure(getattr(value, f.name)) for f in dataclasses.fields(value) if f.init}
    if isinstance(value, Mapping):
        return {str(key): unstructure(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [unstructure(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    return getattr(value, "tolist", lambda: value)()


class _Loader(yaml.SafeLoader):
    """Safe YAML that refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise Fault(f"line {key_node.start_mark.line + 1}: the key {show(key)} is not text")
            if key in seen:
                raise Fault(f"line {key_node.start_mark.line + 1}: the key '{key}' is given twice")
            seen.add(key)
        return super().construct_mapping(node, deep)


def _parse(text: str, where: str) -> Any:
    try:
        return yaml.load(text, Loader=_Loader)
    except Fault as error:
        raise InputError(f"{where}: {error}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark else ""
        raise InputError(f"{where}: {line}not valid YAML ({getattr(error, 'problem', None) or error})") from None


def _copy(node: Any) -> Any:
    if isinstance(node, Mapping):
        return {key: _copy(item) for key, item in node.items()}
    return [_copy(item) for item in node] if isinstance(node, list) else node


def _slot(node: Any, key: str, where: str) -> Any:
    if isinstance(node, dict):
        return key
    if isinstance(node, list):
        if key.isdigit() and int(key) < len(node):
            return int(key)
        raise InputError(f"{where}: '{key}' must be the number of one of {len(node)} list entries, the first is 0")
    raise InputError(f"{where}: '{key}' lies inside {show(node)}, which has no keys")
