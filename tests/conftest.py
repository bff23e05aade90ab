"""What every test may rely on: two virtual CPU devices, a compilation cache kept between runs, and the real data."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

PROJECT_ROOT = Path(__file__).resolve().parent.parent
NO_DATA = "real data not present; set JAXMODEL_DATA"


def _compilation_cache() -> Path:
    """Folder in the user's cache, shared by the test workers and by the commands the tests start."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "jaxmodel" / "tests-xla"


# Environment variables, not jax.config: commands started by a test inherit them.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(_compilation_cache()))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")

import jax  # noqa: E402  (reads the variables above)

jax.config.update("jax_num_cpu_devices", 2)

# The laws are checked on the same examples on every machine; a failure can be repeated.
settings.register_profile(
    "jaxmodel",
    deadline=None,
    max_examples=15,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("jaxmodel")


MANY_MAPS = 20_000
"""Memory maps of a process above which compiled programs are dropped: each takes several, Linux allows 65 530."""


@pytest.fixture(scope="module", autouse=True)
def room_for_compiled_programs() -> Iterator[None]:
    """Between modules, forget the programs of those before when they have become too many for one process."""
    yield
    maps = Path("/proc/self/maps")
    if maps.is_file() and len(maps.read_bytes().splitlines()) > MANY_MAPS:
        jax.clear_caches()
        gc.collect()


def pytest_configure(config: pytest.Config) -> None:
    # Two workers may read and write the same cache entry; jax then warns and compiles again.
    config.addinivalue_line("filterwarnings", "ignore:Error (reading|writing) persistent compilation cache entry")
    # Open3D says so at its import on every machine without a GPU.
    config.addinivalue_line("filterwarnings", "ignore:Open3D was built with CUDA support:ImportWarning")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Root of the real data sets: JAXMODEL_DATA, else ``../shared/data`` beside the project.

    Without it the test is skipped; with JAXMODEL_REQUIRE_DATA=1 it fails instead.
    """
    given = os.environ.get("JAXMODEL_DATA")
    root = Path(given) if given else PROJECT_ROOT.parent / "shared" / "data"
    if root.is_dir():
        return root
    if os.environ.get("JAXMODEL_REQUIRE_DATA") == "1":
        pytest.fail(f"JAXMODEL_REQUIRE_DATA is set but {root} is not a folder")
    pytest.skip(NO_DATA)
