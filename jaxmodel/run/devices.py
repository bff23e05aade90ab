"""What must be set before JAX starts: one virtual device per core and a cache of compiled kernels between runs."""

import os
from pathlib import Path
from typing import Any, cast


def quiet_compiler() -> None:
    """Keep the compiler's log to what is fatal; call before JAX is imported. The user's own choice stands.

    Each kernel read back from the cache would print pages about tuning flags that no processor lists as features.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def prepare_devices() -> int:
    """Give JAX one CPU device per usable core and a persistent compilation cache; call before any array is made.

    The cache lies in ``$JAXMODEL_CACHE``, else ``$XDG_CACHE_HOME/jaxmodel``, else ``~/.cache/jaxmodel``; an empty
    ``JAXMODEL_CACHE`` turns it off, and an unwritable place is passed over. A count of devices that the user has
    already chosen is left alone.

    Returns:
        The number of cores.
    """
    cores = usable_cores()
    import jax

    settings = cast(Any, jax.config)
    if settings.jax_num_cpu_devices < 1 and "xla_force_host_platform_device_count" not in os.environ.get(
        "XLA_FLAGS", ""
    ):
        settings.update("jax_num_cpu_devices", cores)
    cache = cache_folder()
    if cache is not None and settings.jax_compilation_cache_dir is None:
        try:
            cache.mkdir(parents=True, exist_ok=True)
        except OSError:
            return cores
        if os.access(cache, os.W_OK):
            settings.update("jax_compilation_cache_dir", str(cache))
            settings.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    return cores


def usable_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cache_folder() -> Path | None:
    """Where compiled kernels are kept, ``None`` if the user turned the cache off."""
    chosen = os.environ.get("JAXMODEL_CACHE")
    if chosen is not None:
        return Path(chosen) / "xla" if chosen else None
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "jaxmodel" / "xla"
