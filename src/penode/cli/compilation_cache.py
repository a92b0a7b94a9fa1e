"""Compiled programs kept between runs."""

import hashlib
import os
import platform
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import jax

from penode.native.library import processor_flags


def use_compilation_cache() -> None:
    """Keep compiled programs between runs, apart for each processor; the cache is best effort.

    A folder that ``JAX_COMPILATION_CACHE_DIR`` names stays.
    """
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return
    with suppress(OSError, ValueError):
        processor = f"{platform.machine()} {platform.processor()} {processor_flags()}"
        key = hashlib.sha256(f"{processor} {jax.__version__}".encode()).hexdigest()[:16]
        folder = Path.home() / ".cache" / "penode" / "compiled" / key
        folder.mkdir(parents=True, exist_ok=True)
        configure: Callable[[str, object], None] = jax.config.update
        configure("jax_compilation_cache_dir", str(folder))
        configure("jax_persistent_cache_min_compile_time_secs", 0.0)
