"""Pose files that are trees (JSON, YAML): lists of poses, one stream or both, a pose in any of the usual forms.

A pose is a 4 x 4 or 3 x 4 matrix, 16, 12 or 7 numbers, or a mapping with the names of ``pose_columns``; ``position``,
``translation`` or ``tvec`` (three numbers or x, y, z), ``quaternion``, ``orientation`` or ``rotation`` (four numbers,
x, y, z, w, or a 3 x 3 matrix), ``rvec`` (rotation vector) and ``matrix`` are understood too.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from jaxmodel.errors import InputError
from jaxmodel.io.pose_columns import MATRIX, POSITION, QUATERNION, STREAMS, VECTOR, Column, StreamName, unnamed
from jaxmodel.io.pose_columns import read_name as read_column
from jaxmodel.io.pose_tables import Table
from jaxmodel.io.pose_values import Row
from jaxmodel.io.structuring import show
from jaxmodel.io.text_files import read_text

LISTS = ("poses", "samples", "pairs")
TRANSLATIONS = ("position", "translation", "tvec")
ROTATIONS = ("quaternion", "orientation", "rotation", "R")
MATRICES = ("matrix", "transform", "T")


def read_tree(path: Path, quaternion: str) -> dict[StreamName | None, Table]:
    """The columns and rows of each stream, or of the only one under ``None``; a broken file is an ``InputError``."""
    text = read_text(path)
    if not text.strip():
        raise InputError(f"{path}: holds no poses, the file is empty")
    try:
        tree = json.loads(text) if path.suffix.lower() == ".json" else yaml.safe_load(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}, line {error.lineno}: not valid JSON ({error.msg})") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}{place}: not valid YAML ({getattr(error, 'problem', None) or error})") from None
    return {
        stream: _table(path, poses, "wxyz" if quaternion == "wxyz" else "xyzw")
        for stream, poses in _streams(path, tree).items()
    }


def _streams(path: Path, tree: Any) -> dict[StreamName | None, list[tuple[str, Any]]]:
    """Each stream's poses with their places."""
    if isinstance(tree, Mapping):
        for name in LISTS:
            if set(tree) == {name}:
                return _streams(path, tree[name])
        named: dict[StreamName | None, tuple[Any, Any]] = {}
        named |= {STREAMS[str(key).lower()]: (key, value) for key, value in tree.items() if str(key).lower() in STREAMS}
        if len(named) == 2:
            unknown = sorted(str(key) for key in tree if str(key).lower() not in STREAMS)
            if unknown:
                raise InputError(f"{path}: unknown key {show(unknown[0])} beside the hand and the camera")
            return {stream: _poses(path, str(key), value) for stream, (key, value) in named.items()}
        if named:
            raise InputError(f"{path}: holds the {next(iter(named))}'s poses, but none of the other stream")
        return {None: _poses(path, "", tree)}
    poses = _poses(path, "", tree)
    pairs = [isinstance(pose, Mapping) and {str(key).lower() for key in pose} & set(STREAMS) for _, pose in poses]
    if not any(pairs):
        return {None: poses}
    streams: tuple[StreamName, ...] = ("hand", "camera")
    return {stream: [(place, _half(path, place, pose, stream)) for place, pose in poses] for stream in streams}


def _half(path: Path, place: str, pair: Any, stream: StreamName) -> Any:
    """One stream's pose of an entry that holds both; what stands beside them (a time) belongs to both."""
    keys = [] if not isinstance(pair, Mapping) else [k for k in pair if STREAMS.get(str(k).lower()) == stream]
    if len(keys) != 1:
        raise InputError(f"{path}, {place}: expected a mapping with the hand's and the camera's pose")
    pose = pair[keys[0]]
    beside = {key: value for key, value in pair.items() if str(key).lower() not in STREAMS}
    if not beside:
        return pose
    return {**beside, **pose} if isinstance(pose, Mapping) else {**beside, "matrix": pose}


def _poses(path: Path, key: str, tree: Any) -> list[tuple[str, Any]]:
    if isinstance(tree, Mapping) and tree:
        return [(f"{key} {name!r}".strip(), _with_image(pose, str(name))) for name, pose in tree.items()]
    if isinstance(tree, list) and tree:
        return [(f"{key} entry {number}".strip(), pose) for number, pose in enumerate(tree)]
    raise InputError(f"{path}: expected a list of poses{f' under {key!r}' if key else ''}, found {show(tree)}")


def _with_image(pose: Any, name: str) -> Any:
    return {"image": name, **pose} if isinstance(pose, Mapping) else {"image": name, "matrix": pose}


def _table(path: Path, poses: list[tuple[str, Any]], quaternion: Any) -> Table:
    columns: list[Column] = []
    rows = []
    for place, pose in poses:
        flat = _flat(pose, f"{path}, {place}", quaternion)
        if not rows:
            columns = list(flat)
        if set(flat) != set(columns):
            raise InputError(
                f"{path}, {place}: has {', '.join(c.quantity for c in flat)} where the first pose has "
                f"{', '.join(c.quantity for c in columns)}"
            )
        rows.append(Row(place, [flat[column] for column in columns]))
    return columns, rows


def _flat(pose: Any, where: str, quaternion: Any) -> dict[Column, Any]:
    """One pose as named values."""
    if isinstance(pose, list):
        if pose and all(isinstance(row, list) for row in pose):
            if not all(len(row) == 4 for row in pose) or len(pose) not in (3, 4):
                sizes = " x ".join(map(str, (len(pose), len(pose[0]))))
                raise InputError(f"{where}: expected a 4 x 4 or 3 x 4 matrix, found one of {sizes}")
            pose = [value for row in pose for value in row]
        return dict(zip(unnamed(len(pose), quaternion, where), pose, strict=True))
    if not isinstance(pose, Mapping):
        raise InputError(f"{where}: expected a pose (a matrix, numbers or a mapping), found {show(pose)}")
    flat: dict[Column, Any] = {}
    for key, value in pose.items():
        for name, number in _expanded(str(key), value, where, quaternion).items():
            column = read_column(name, where) if isinstance(name, str) else name
            if column in flat:
                raise InputError(f"{where}: {column.quantity} is given twice")
            flat[column] = number
    return flat


def _expanded(key: str, value: Any, where: str, quaternion: Any) -> dict[Any, Any]:
    if key in MATRICES:
        return dict(_flat(value, f"{where}, {key}", quaternion))
    if not isinstance(value, (list, Mapping)):
        return {key: value}
    letters = list(value) if isinstance(value, Mapping) else None
    if key in TRANSLATIONS or (key == "t" and letters is None):
        return _named(POSITION, ("x", "y", "z"), value, f"{where}, {key}")
    if key == "rvec":
        return _named(VECTOR, ("x", "y", "z"), value, f"{where}, {key}")
    if key in ROTATIONS:
        if isinstance(value, list) and len(value) == 3 and all(isinstance(row, list) for row in value):
            return _named(MATRIX, (), [number for row in value for number in row], f"{where}, {key}")
        order = tuple(quaternion) if letters is None else ("x", "y", "z", "w")
        return _named(tuple(f"q{letter}" for letter in order) if letters is None else QUATERNION, order, value,
                      f"{where}, {key}")  # fmt: skip
    raise InputError(f"{where}: unknown key {show(key)} with {show(value)}")


def _named(names: tuple[str, ...], letters: tuple[str, ...], value: Any, where: str) -> dict[str, Any]:
    if isinstance(value, Mapping):
        if set(value) != set(letters):
            raise InputError(f"{where}: expected the keys {', '.join(letters)}, found {', '.join(map(str, value))}")
        return {name: value[letter] for name, letter in zip(names, letters, strict=True)}
    if len(value) != len(names):
        raise InputError(f"{where}: expected {len(names)} numbers, found {len(value)}")
    return dict(zip(names, value, strict=True))
