"""The kernels of `kernels.c`: compiled once a machine, registered with XLA; without them JAX runs.

A wheel stays pure: a C compiler is used where there is one, and nothing else changes without it.
"""

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from importlib.metadata import version
from pathlib import Path

import jax

#: Set to 0, everything is left to JAX.
SWITCH = "PENODE_NATIVE"

_SOURCE = Path(__file__).with_name("kernels.c")
_FLAGS = ("-std=gnu11", "-O3", "-march=native", "-fPIC", "-shared", "-fvisibility=hidden")
_FUNCTIONS = (
    "penode_spline_jets",
    "penode_spline_products",
    "penode_harmonics",
    "penode_add_products",
)
_SECONDS = 60


@cache
def available() -> bool:
    """Whether the kernels are there; compiles and registers them at the first call."""
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if os.environ.get(SWITCH) == "0" or compiler is None:
        return False
    try:
        library = ctypes.CDLL(str(_compiled(compiler)))
        for name in _FUNCTIONS:
            handler = jax.ffi.pycapsule(getattr(library, name))
            jax.ffi.register_ffi_target(name, handler, platform="cpu")
    except (OSError, AttributeError, RuntimeError, subprocess.SubprocessError):
        return False
    return True


def _compiled(compiler: str) -> Path:
    """Return the shared library of this source, compiler and processor."""
    headers = jax.ffi.include_dir()
    processor = f"{platform.machine()} {processor_flags()}"
    parts = (compiler, version("jaxlib"), processor, *_FLAGS, _SOURCE.read_text())
    key = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
    library = Path.home() / ".cache" / "penode" / "native" / f"{key}.so"
    if not library.exists():
        library.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            made = Path(folder) / library.name
            command = [compiler, *_FLAGS, "-I", headers, str(_SOURCE), "-o", str(made)]
            subprocess.run(command, check=True, capture_output=True, timeout=_SECONDS)
            made.replace(library)
    return library


def processor_flags() -> str:
    """Return what the processor can do, as the system lists it; empty where it does not."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    return next((line for line in lines if line.startswith("flags")), "")
