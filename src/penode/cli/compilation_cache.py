"""Compiled programs kept between runs, for all checkouts of a user."""

import hashlib
import os
import platform
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import jax

from penode.native.library import processor_flags

#: Bytes of programs that are kept; those least recently used go first.
_MOST = 512 << 20
#: Seconds between two looks at how much there is: thousands of files take a tenth of a second.
_INTERVAL = 86_400.0


def use_compilation_cache() -> Path | None:
    """Keep compiled programs between runs, apart for each processor, in a folder, if possible.

    A folder that ``JAX_COMPILATION_CACHE_DIR`` names is taken.
    """
    configure: Callable[[str, object], None] = jax.config.update
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        configure("jax_persistent_cache_min_compile_time_secs", 0.0)
    named = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if named:
        return Path(named)
    with suppress(OSError, ValueError):
        processor = f"{platform.machine()} {platform.processor()} {processor_flags()}"
        key = hashlib.sha256(f"{processor} {jax.__version__}".encode()).hexdigest()[:16]
        compiled = Path.home() / ".cache" / "penode" / "compiled"
        folder = compiled / key
        folder.mkdir(parents=True, exist_ok=True)
        configure("jax_compilation_cache_dir", str(folder))
        remove_oldest(compiled, _MOST)
        return folder
    return None


def remove_oldest(compiled: Path, most: int) -> None:
    """Remove programs of any version beyond ``most`` bytes, least recently used first, once a day.

    JAX can bound its cache too, but reads the whole folder under a lock for each new program.
    """
    looked = compiled / "looked"
    if looked.exists() and time.time() - looked.stat().st_mtime < _INTERVAL:
        return
    looked.touch()
    programs = [(path, path.stat()) for path in compiled.glob("*/*")]
    programs.sort(key=lambda program: max(program[1].st_atime, program[1].st_mtime), reverse=True)
    kept = 0
    for path, found in programs:
        kept += found.st_size
        if kept > most:
            path.unlink(missing_ok=True)
