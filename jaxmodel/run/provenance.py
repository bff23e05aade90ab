"""What a result came from: configuration, seed, versions, device, input hashes and command, in ``manifest.json``."""

import hashlib
import platform
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from jaxmodel import __version__
from jaxmodel.errors import InputError

_PACKAGES = ("jax", "jaxlib", "numpy", "scipy", "equinox", "polars", "open3d")
_DECISIVE = ("jaxmodel", "jax", "jaxlib", "numpy", "scipy")
"""Versions that must agree for a run to be continued: they decide the last bits of the table."""


def hash_files(paths: Iterable[str | Path]) -> dict[str, str]:
    """File -> SHA-256 of its content."""
    hashes = {}
    for path in paths:
        try:
            hashes[str(path)] = hashlib.sha256(Path(path).read_bytes()).hexdigest()
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    return hashes


def versions() -> dict[str, str]:
    """Versions of jaxmodel, Python and the libraries that shape the numbers."""
    found = {"jaxmodel": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def device() -> dict[str, Any]:
    """What the kernels run on."""
    import jax

    devices = jax.devices()
    return {
        "platform": devices[0].platform,
        "kind": devices[0].device_kind,
        "devices": len(devices),
        "machine": platform.machine(),
        "system": platform.system(),
    }


def manifest(experiment: str, resolved: Mapping[str, Any], inputs: Mapping[str, str], command: str) -> dict[str, Any]:
    """The content of ``manifest.json``; ``resolved`` holds the seed."""
    return {
        "experiment": experiment,
        "command": command,
        "config": dict(resolved),
        "seed": resolved.get("seed"),
        "inputs": dict(inputs),
        "versions": versions(),
        "device": device(),
    }


def facts(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Where a run's numbers came from, as the short list on top of its report."""
    device = manifest["device"]
    return {
        "command": manifest["command"],
        "seed": str(manifest["seed"]),
        "device": f"{device['devices']} x {device['kind']} ({device['machine']})",
        "versions": ", ".join(f"{name} {version}" for name, version in manifest["versions"].items()),
    }


def check_same(old: Mapping[str, Any], new: Mapping[str, Any], where: Path) -> None:
    """Refuse to continue a run whose configuration, inputs or decisive versions differ, naming the first difference."""
    for key, was, now in _differences(old.get("config", {}), new["config"]):
        raise InputError(f"{where}: cannot be resumed, {key} was {was!r} and is {now!r} now")
    for key, was, now in _differences(old.get("inputs", {}), new["inputs"]):
        change = "is new" if was is None else "is gone" if now is None else "has changed since"
        raise InputError(f"{where}: cannot be resumed, the input {key} {change}")
    for name in _DECISIVE:
        was, now = old.get("versions", {}).get(name), new["versions"].get(name)
        if was != now:
            raise InputError(f"{where}: cannot be resumed, it was begun with {name} {was} and this is {name} {now}")


def _differences(old: Any, new: Any, path: str = "") -> Iterable[tuple[str, Any, Any]]:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in [*old, *(k for k in new if k not in old)]:
            yield from _differences(old.get(key), new.get(key), f"{path}.{key}" if path else str(key))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (was, now) in enumerate(zip(old, new, strict=True)):
            yield from _differences(was, now, f"{path}.{index}")
    elif old != new:
        yield path, old, new
