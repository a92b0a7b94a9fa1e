"""Bad settings: entries of the study file, options of the commands, configurations of the bench."""

import os
from collections.abc import Callable
from pathlib import Path

from validate.bad_files.good import NAMES, csv

IDENTIFY = ("identify", "run.csv", "--out", "out")
SIMULATION = """
machine = "traction_300A"
duration = 0.05
speed_rpm = 1000
seed = 1
reference = { kind = "lissajous", amplitude = 200.0, rate_d = 50.0, rate_q = 54.0 }
"""


def _channel(name: str, entry: str) -> str:
    """Return a study file that maps every channel to the column of its name, but one."""
    channels = {one: repr(one) for one in NAMES} | {name: entry}
    return "[channels]\n" + "\n".join(f"{one} = {what}" for one, what in channels.items())


#: Text of a study file beside a good recording; ``identify`` reads both.
STUDY: dict[str, bytes | str] = {
    "not TOML": "horizon: 3",
    "a line that ends early": 'flux_map = "coen',
    "bytes of a picture": b"\x89PNG\r\n\x1a\n\0\0",
    "latin-1": 'u_d = "Spannung f\xfcr d"'.encode("latin-1"),
    "2 MB of comments": "# again\n" * 250_000,
    "an entry twice": "horizon = 3\nhorizon = 4",
    "lists 100 000 deep": "angle_orders = " + "[" * 100_000,
    "a number of 4301 digits": "seed = " + "9" * 4301,
    "a number beyond 64 bits": f"seed = {2**64}",
    "an entry misspelt": "horizn = 3",
    "horizon = 0": "horizon = 0",
    "horizon = text": 'horizon = "long"',
    "horizon beyond the recording": "horizon = 2500",
    "seed = -1": "seed = -1",
    "pole_pairs = 0": "pole_pairs = 0",
    "samples = 0": "samples = 0",
    "samples too few": "samples = 5",
    "flux_map unknown": 'flux_map = "coenrgy"',
    "terms unknown": 'terms = ["friction"]',
    "terms in no brackets": 'terms = "dead_time"',
    "terms of one role twice": 'terms = ["dead_time", "dead_time"]',
    "a term without its channel": 'terms = ["temperature_resistance"]',
    "angle orders negative": "angle_orders = [-6]",
    "angle orders for a map without them": 'flux_map = "polynomial"\nangle_orders = [6]',
    "angle order beyond the samples": "angle_orders = [100000]",
    "hold unknown": 'hold = "linear"',
    "purpose unknown": 'purpose = "pleasure"',
    "resample unknown": 'resample = "cubic"',
    "u_base = 0": "u_base = 0",
    "u_dc = nan": "u_dc = nan",
    "name_plate negative": "[name_plate]\nresistance = -0.1",
    "name_plate = number": "name_plate = 3",
    "accuracy negative": "[accuracy]\ncurrent_gain = -0.1",
    "accuracy = inf": "[accuracy]\ncurrent_gain = inf",
    "channels = list": "channels = [1, 2]",
    "a channel unknown": "[channels]\nid = 'i_d'",
    "a channel of no column": _channel("i_d", "{ unit = 'A' }"),
    "a channel = number": _channel("i_d", "3"),
    "a channel's entry unknown": _channel("i_d", "{ column = 'i_d', gain = 2 }"),
    "a column that is not there": _channel("i_d", "'Id'"),
    "a unit unknown": _channel("i_d", "{ column = 'i_d', unit = 'furlong' }"),
    "a unit of another quantity": _channel("i_d", "{ column = 'i_d', unit = 'V' }"),
    "scale = nan": _channel("i_d", "{ column = 'i_d', scale = nan }"),
    "sign = 2": _channel("i_d", "{ column = 'i_d', sign = 2 }"),
    "delay = 0.5": _channel("i_d", "{ column = 'i_d', delay = 0.5 }"),
    "delay beyond the recording": _channel("i_d", "{ column = 'i_d', delay = 9999 }"),
    "rms = text": _channel("i_d", "{ column = 'i_d', rms = 'yes' }"),
    "mechanical without pole pairs": _channel(
        "omega_el", "{ column = 'omega_el', mechanical = true }"
    ),
    "times a column that is not there": _channel("u_d", "{ column = 'u_d', times = 'u_dc' }"),
    "sweep = number": "sweep = 3",
}

#: Options, with a good recording ``run.csv`` at hand; names of files stand for themselves.
OPTIONS: dict[str, tuple[str, ...]] = {
    "no option --out": ("identify", "run.csv"),
    "an option misspelt": (*IDENTIFY, "--horizn", "3"),
    "a command misspelt": ("identfy", "run.csv", "--out", "out"),
    "an argument too many": ("init", "run.csv", "more.csv"),
    "no recording": ("identify", "--out", "out"),
    "--horizon text": (*IDENTIFY, "--horizon", "long"),
    "--horizon 0": (*IDENTIFY, "--horizon", "0"),
    "--horizon beyond the recording": (*IDENTIFY, "--horizon", "1000000000"),
    "--seed text": (*IDENTIFY, "--seed", "one"),
    "--seed -1": (*IDENTIFY, "--seed", "-1"),
    "--seed of 100 digits": (*IDENTIFY, "--seed", "9" * 100),
    "--flux-map unknown": (*IDENTIFY, "--flux-map", "table"),
    "--terms unknown": (*IDENTIFY, "--terms", "friction"),
    "--angle-orders text": (*IDENTIFY, "--angle-orders", "six"),
    "--angle-orders of 5000 digits": (*IDENTIFY, "--angle-orders", "9" * 5000),
    "--hold unknown": (*IDENTIFY, "--hold", "phase"),
    "--purpose unknown": (*IDENTIFY, "--purpose", "fun"),
    "--config missing": (*IDENTIFY, "--config", "gone.toml"),
    "--config a pipe": (*IDENTIFY, "--config", "pipe"),
    "--config an endless device": (*IDENTIFY, "--config", "/dev/zero"),
    "--config a recording": (*IDENTIFY, "--config", "run.csv"),
    "--validate missing": (*IDENTIFY, "--validate", "gone.csv"),
    "--validate of another sampling time": (*IDENTIFY, "--validate", "slow.csv"),
    "recordings of two sampling times": ("identify", "run.csv", "slow.csv", "--out", "out"),
    "--out a file": ("identify", "run.csv", "--out", "run.csv"),
    "--out below a file": ("identify", "run.csv", "--out", "run.csv/out"),
    "--out a device": ("identify", "run.csv", "--out", "/dev/null"),
    "--out where nothing can be written": ("identify", "run.csv", "--out", "/proc/penode"),
    "--out too long": ("identify", "run.csv", "--out", "x" * 300),
    "--out a dangling link": ("identify", "run.csv", "--out", "dangling"),
    "--inverter without an angle": ("identify", "flat.csv", "--out", "out", "--inverter"),
    "check: --picture below a file": ("check", "run.csv", "--picture", "run.csv/a.png"),
    "check: --picture of an unknown kind": ("check", "run.csv", "--picture", "a.xyz"),
    "init: --out exists": ("init", "run.csv", "--out", "slow.csv"),
    "init: --out in no folder": ("init", "run.csv", "--out", "run.csv/study.toml"),
    "sweep: --horizons text": ("sweep", "run.csv", "--out", "out", "--horizons", "1,x"),
    "sweep: --seeds 10^6": ("sweep", "run.csv", "--out", "out", "--seeds", "1000000"),
    "sweep: --jobs 0": ("sweep", "run.csv", "--out", "out", "--jobs", "0"),
    "sweep: no recording": ("sweep", "--out", "out"),
    "sweep: an empty list of recordings": ("sweep", "--out", "out", "--config", "sweep.toml"),
    "sweep: no such cluster": ("sweep", "run.csv", "--out", "out", "--dask", "127.0.0.1:9"),
    "simulate: no such machine file": ("simulate", "gone.toml", "--out", "a.csv"),
    "simulate: a suffix unknown": ("simulate", "good.toml", "--out", "a.xlsx"),
    "simulate: --out in no folder": ("simulate", "good.toml", "--out", "run.csv/a.csv"),
    "reproduce: unknown": ("reproduce", "nothing", "--out", "out"),
    "demo: --out a file": ("demo", "--out", "run.csv"),
}

#: Lines of a simulation in place of its good ones.
SIMULATE: dict[str, tuple[str, str]] = {
    "simulate: seed = -1": ("seed = 1", "seed = -1"),
    "simulate: an empty kind": ('kind = "lissajous"', "kind = []"),
    "simulate: duration = 0": ("duration = 0.05", "duration = 0"),
    "simulate: duration = 10^9 s": ("duration = 0.05", "duration = 1e9"),
    "simulate: no such machine": ("traction_300A", "traction_3A"),
    "simulate: a machine of no file": ('"traction_300A"', '{ map = "gone.csv" }'),
    "simulate: amplitude = inf": ("200.0", "inf"),
    "simulate: amplitude beyond reach": ("200.0", "1e6"),
    "simulate: an entry unknown": ("seed = 1", "sed = 1"),
}


def put(folder: Path) -> None:
    """Make the files that options name in a folder.

    Parameters
    ----------
    folder : Path
    """
    (folder / "run.csv").write_text(csv())
    rows = csv().splitlines()
    (folder / "slow.csv").write_text("\n".join([rows[0], *rows[1::3], ""]))
    (folder / "flat.csv").write_text("".join(f"{row.rpartition(',')[0]}\n" for row in rows))
    (folder / "good.toml").write_text(SIMULATION)
    (folder / "sweep.toml").write_text("[sweep]\nrecordings = []\n")
    (folder / "folder").mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "dangling").symlink_to("gone/there")


def cases() -> dict[str, tuple[Callable[[Path], None], tuple[str, ...]]]:
    """Return what makes the files of each kind of bad setting, and the arguments of penode."""

    def study(text: bytes | str) -> Callable[[Path], None]:
        def make(folder: Path) -> None:
            (folder / "run.csv").write_text(csv())
            content = text.encode() if isinstance(text, str) else text
            (folder / "study.toml").write_bytes(content)

        return make

    def simulation(old: str, new: str) -> Callable[[Path], None]:
        assert old in SIMULATION, old
        return lambda folder: _write(folder / "sim.toml", SIMULATION.replace(old, new))

    asked = (*IDENTIFY, "--config", "study.toml")
    return {
        **{f"study: {kind}": (study(text), asked) for kind, text in STUDY.items()},
        **{kind: (put, arguments) for kind, arguments in OPTIONS.items()},
        **{
            kind: (simulation(*change), ("simulate", "sim.toml", "--out", "a.csv"))
            for kind, change in SIMULATE.items()
        },
    }


def _write(path: Path, text: str) -> None:
    path.write_text(text)
