"""What is set before JAX starts, seen from a fresh process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from jaxmodel.run.devices import cache_folder, usable_cores


def seen(**environment: str) -> list[str]:
    script = (
        "from jaxmodel.run.devices import prepare_devices; prepare_devices(); import jax;"
        "print(len(jax.devices()), jax.config.jax_compilation_cache_dir)"
    )
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("JAX", "XLA"))}
    root = str(Path(__file__).resolve().parents[2])
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**kept, "PYTHONPATH": root, "JAX_PLATFORMS": "cpu", **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


def test_one_device_a_core_and_the_cache_where_asked(tmp_path: Path) -> None:
    assert seen(JAXMODEL_CACHE=str(tmp_path)) == [str(usable_cores()), str(tmp_path / "xla")]


def test_the_users_own_choice_stands(tmp_path: Path) -> None:
    assert seen(JAXMODEL_CACHE="", XLA_FLAGS="--xla_force_host_platform_device_count=3") == ["3", "None"]


def test_an_unusable_cache_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert seen(JAXMODEL_CACHE=str(tmp_path / "file"))[1] == "None"


def test_cache_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("JAXMODEL_CACHE", raising=False)
    assert cache_folder() == tmp_path / "jaxmodel" / "xla"
    monkeypatch.setenv("JAXMODEL_CACHE", "")
    assert cache_folder() is None


@pytest.mark.slow
def test_kernels_read_back_from_the_cache_print_nothing(tmp_path: Path) -> None:
    command = "import sys; from jaxmodel.run.cli import main; main(sys.argv[1:])"
    small = ("--scans.names", "[boulder]", "--starts.count", "2", "--claims.starts", "0")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("JAX", "XLA", "TF_"))}
    environment = {**kept, "JAX_PLATFORMS": "cpu", "JAXMODEL_CACHE": str(tmp_path / "cache")}
    for run in ("first", "second"):
        words = [sys.executable, "-c", command, "run", "quickstart", *small, "--out", str(tmp_path / run)]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert any((tmp_path / "cache").rglob("*"))
    assert "cpu_aot_loader" not in done.stderr
