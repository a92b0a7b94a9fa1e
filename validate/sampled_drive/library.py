"""The plant of `plant.c`, compiled at first use and kept in the user's cache directory."""

import ctypes
import hashlib
import os
import shutil
import subprocess
from functools import cache
from pathlib import Path

_SOURCE = Path(__file__).with_name("plant.c")
_FLAGS = ("-std=c11", "-O2", "-fPIC", "-shared")
ORDERS = 4

Double, Orders = ctypes.c_double, ctypes.c_double * ORDERS


class MachineRecord(ctypes.Structure):
    """``Machine`` of `plant.c`."""

    _fields_ = (
        *(
            (name, Double)
            for name in (
                *("resistance", "leak_d", "leak_q", "magnet", "magnet_current", "own_d", "knee_d"),
                *("own_q", "knee_q", "shared", "knee_s", "ratio", "bend", "iron_conductance"),
            )
        ),
        *((name, Orders) for name in ("order", "a", "b", "c", "d")),
    )


class InverterRecord(ctypes.Structure):
    """``Inverter`` of `plant.c`."""

    _fields_ = (
        *(
            (name, Double)
            for name in ("period", "dead_time", "node_capacitance", "thermal", "saturation")
        ),
        ("switched", ctypes.c_int),
    )


class Jet(ctypes.Structure):
    """``Jet`` of `plant.c`."""

    _fields_ = tuple(
        (name, Double)
        for name in (
            *("w", "psi_d", "psi_q", "l_dd", "l_dq", "l_qq", "slope_d", "slope_q", "slope_w"),
        )
    )


@cache
def plant() -> ctypes.CDLL:
    """Return the compiled plant.

    Raises
    ------
    RuntimeError
        If there is no C compiler.
    """
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        raise RuntimeError("no C compiler (cc, gcc, clang) is installed; the plant needs one.")
    key = hashlib.sha256("\n".join((compiler, *_FLAGS, _SOURCE.read_text())).encode()).hexdigest()
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "penode-validate"
    library = folder / f"plant-{key[:16]}.so"
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        made = library.with_suffix(f".{os.getpid()}")
        command = [compiler, *_FLAGS, str(_SOURCE), "-o", str(made), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
        made.replace(library)
    loaded = ctypes.CDLL(str(library))
    pair, pointer = Double * 2, ctypes.POINTER
    machine, inverter = pointer(MachineRecord), pointer(InverterRecord)
    loaded.machine_jet.argtypes = (machine, Double, Double, Double, pointer(Jet))
    loaded.terminal_current.argtypes = (machine, pair, Double, Double, pair)
    loaded.advance.argtypes = (
        *(machine, inverter, pair, Double, Double, Double * 3, Double, Double),
    )
    for function in (loaded.machine_jet, loaded.terminal_current, loaded.advance):
        function.restype = None
    return loaded
