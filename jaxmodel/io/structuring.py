"""The rules by which raw YAML values become typed objects: the hooks given to cattrs, and its errors in words."""

import dataclasses
import difflib
import re
import types
import typing
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Literal, Union, get_args, get_origin

_REAL = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_SCALARS = (bool, int, float, str)
_NAMES = {bool: "true or false", int: "a whole number", float: "a number", str: "text", type(None): "null"}


class Fault(ValueError):
    """A fault whose text is already the sentence to show."""


def show(raw: Any) -> str:
    """A wrong value in words, short enough for a sentence."""
    text = repr(raw)
    kind = {dict: "a mapping", list: "a list", str: "the text", type(None): "nothing"}.get(type(raw), "")
    return kind if kind in ("a mapping", "a list", "nothing") else f"{kind} {text[:60]}".strip()


def nearest(name: Any, right: Sequence[Any]) -> str:
    """``did you mean 'x'?`` when one of ``right`` resembles ``name``, else the list of all of them."""
    close = difflib.get_close_matches(str(name), [str(r) for r in right], n=1, cutoff=0.5)
    return f"did you mean '{close[0]}'?" if close else "expected one of: " + ", ".join(map(str, right))


def _members(kind: Any) -> list[Any]:
    return list(get_args(kind)) if get_origin(kind) in (Union, types.UnionType) else [kind]


def _tag(cls: type) -> str | None:
    annotation = typing.get_type_hints(cls).get("kind")
    return get_args(annotation)[0] if get_origin(annotation) is Literal else None


def _scalar(raw: Any, kind: type) -> Any:
    if kind is float and not isinstance(raw, bool):
        if isinstance(raw, (int, float)) and raw == raw:
            return float(raw)
        if isinstance(raw, str) and _REAL.fullmatch(raw.strip()):
            return float(raw)
    elif type(raw) is kind:
        return raw
    raise Fault(f"expected {_NAMES[kind]}, got {show(raw)}")


def _literal(raw: Any, kind: Any) -> Any:
    for value in get_args(kind):
        if type(value) is type(raw) and value == raw:
            return value
    raise Fault(f"got {show(raw)}, {nearest(raw, get_args(kind))}")


def _array(raw: Any, _: Any) -> Any:
    import numpy as np

    if isinstance(raw, (list, tuple)):
        return np.asarray([_array(item, _) for item in raw], dtype=float)
    return _scalar(raw, float)


@lru_cache(maxsize=1)
def converter() -> Any:
    """The one strict converter, made at first use: importing cattrs is left until a file is read."""
    import cattrs
    from cattrs.gen import make_dict_structure_fn

    rules = cattrs.Converter(detailed_validation=True)
    entry_note, entry_error = cattrs.IterableValidationNote, typing.cast(Any, cattrs.IterableValidationError)

    def of_class(cls: Any) -> Any:
        inner = make_dict_structure_fn(cls, rules, _cattrs_forbid_extra_keys=True, _cattrs_detailed_validation=True)

        def hook(raw: Any, _: Any) -> Any:
            if not isinstance(raw, Mapping):
                keys = ", ".join(f.name for f in dataclasses.fields(cls) if f.init)
                raise Fault(f"expected a mapping with keys {keys}, got {show(raw)}")
            return inner(raw, _)

        return hook

    def of_union(kind: Any) -> Any:
        members = _members(kind)
        classes = [m for m in members if dataclasses.is_dataclass(m)]
        others = [m for m in members if m not in classes and m is not type(None)]

        def hook(raw: Any, _: Any) -> Any:
            if raw is None and type(None) in members:
                return None
            if isinstance(raw, Mapping) and classes:
                return rules.structure(raw, _tagged(raw, classes))
            for member in others:
                if isinstance(raw, (list, tuple)) and get_origin(member) in (tuple, list):
                    return rules.structure(raw, member)
                try:
                    return rules.structure(raw, member)
                except Exception:
                    continue
            expected = [_expected(m) for m in members if m not in classes]
            raise Fault(f"expected {' or '.join(['a mapping'] * bool(classes) + expected)}, got {show(raw)}")

        return hook

    def of_sequence(kind: Any) -> Any:
        arguments = get_args(kind) or (Any, ...)
        repeated = get_origin(kind) is list or arguments[-1] is Ellipsis
        make = list if (get_origin(kind) or kind) is list else tuple

        def hook(raw: Any, _: Any) -> Any:
            if not isinstance(raw, (list, tuple)):
                raise Fault(f"expected a list, got {show(raw)}")
            if not repeated and len(raw) != len(arguments):
                raise Fault(f"expected a list of {len(arguments)} entries, got {len(raw)}")
            wanted = [arguments[0]] * len(raw) if repeated else arguments
            result = []
            for index, (item, inner) in enumerate(zip(raw, wanted, strict=True)):
                try:
                    result.append(item if inner is Any else rules.structure(item, inner))
                except Exception as error:
                    note = entry_note(f"entry {index}", index, inner)
                    error.__notes__ = [*getattr(error, "__notes__", []), note]
                    raise entry_error("list", [error], kind) from error
            return make(result)

        return hook

    for scalar in _SCALARS:
        rules.register_structure_hook(scalar, _scalar)
    rules.register_structure_hook_func(lambda kind: get_origin(kind) is Literal, _literal)
    rules.register_structure_hook_func(_is_array, _array)
    rules.register_structure_hook_factory(lambda kind: (get_origin(kind) or kind) in (tuple, list), of_sequence)
    rules.register_structure_hook_factory(lambda kind: get_origin(kind) in (Union, types.UnionType), of_union)
    rules.register_structure_hook_factory(dataclasses.is_dataclass, of_class)
    return rules


def _expected(member: Any) -> str:
    if get_origin(member) is Literal:
        return " or ".join(map(repr, get_args(member)))
    return (
        "a list" if get_origin(member) in (tuple, list) else _NAMES.get(member, getattr(member, "__name__", "a value"))
    )


def _is_array(kind: Any) -> bool:
    return hasattr(kind, "dim_str") or f"{getattr(kind, '__module__', '')}.{getattr(kind, '__name__', '')}" in (
        "numpy.ndarray", "jax.Array", "jaxlib._jax.Array",
    )  # fmt: skip


def _tagged(raw: Mapping[str, Any], classes: list[Any]) -> Any:
    tags = {_tag(cls): cls for cls in classes}
    if len(classes) == 1 and "kind" not in raw:
        return classes[0]
    if "kind" not in raw:
        raise Fault(f"the key 'kind' is missing, expected one of: {', '.join(map(str, tags))}")
    if raw["kind"] not in tags:
        if len(classes) == 1:
            return classes[0]
        raise Fault(f"kind is {show(raw['kind'])}, {nearest(raw['kind'], list(tags))}")
    return tags[raw["kind"]]


def first_fault(error: BaseException, path: tuple[str, ...] = ()) -> tuple[str, str]:
    """Dotted path and sentence of the first fault in cattrs' tree of errors; unknown keys go before missing ones."""
    import cattrs

    for note in getattr(error, "__notes__", []):
        if isinstance(note, cattrs.AttributeValidationNote):
            path = (*path, note.name)
        elif isinstance(note, cattrs.IterableValidationNote):
            path = (*path, str(note.index))
    if isinstance(error, BaseExceptionGroup):
        ordered = sorted(error.exceptions, key=lambda e: not isinstance(e, cattrs.ForbiddenExtraKeysError))
        return first_fault(ordered[0], path)
    if isinstance(error, cattrs.ForbiddenExtraKeysError):
        key = sorted(error.extra_fields)[0]
        right = [f.name for f in dataclasses.fields(typing.cast(Any, error.cl)) if f.init]
        return ".".join((*path, key)), f"unknown key, {nearest(key, right)}"
    if isinstance(error, KeyError):
        return ".".join(path), "this key is required and missing"
    if not isinstance(error, ValueError):
        raise error  # a fault of the program, not of the file
    return ".".join(path), str(error)
