"""One recording gives the same numbers in every file format and every odd convention."""

import json
from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
from asammdf import MDF
from asammdf import Signal as MdfSignal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.pmsm.machine.frames import abc_from_dq
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.study import identify
from penode.pmsm.study_file import load_study
from penode.pmsm.study_settings import Study

# --- writers ----------------------------------------------------------------------------------

#: Name -> values and unit; the first column holds the times.
Columns = dict[str, tuple[np.ndarray, str]]


def values_of(columns: Columns) -> dict[str, np.ndarray]:
    return {name: values for name, (values, _) in columns.items()}


def text(columns: Columns, separator: str, decimal: str, units: bool) -> str:
    rows = np.stack(list(values_of(columns).values()), axis=1)
    lines = [separator.join(columns)]
    if units:
        lines.append(separator.join(f"[{unit}]" for _, unit in columns.values()))
    lines += [separator.join(repr(float(x)).replace(".", decimal) for x in row) for row in rows]
    return "\n".join(lines) + "\n"


def csv(folder: Path, columns: Columns) -> Path:
    path = folder / "run.csv"
    path.write_text(text(columns, ",", ".", units=False))
    return path


def german_csv(folder: Path, columns: Columns) -> Path:
    path = folder / "run.csv"
    path.write_text(text(columns, ";", ",", units=True))
    return path


def tabbed_csv(folder: Path, columns: Columns) -> Path:
    path = folder / "run.csv"
    path.write_text(text(columns, "\t", ".", units=False))
    return path


def parquet(folder: Path, columns: Columns) -> Path:
    path = folder / "run.parquet"
    pl.DataFrame(values_of(columns)).write_parquet(path)
    return path


def mat5(folder: Path, columns: Columns) -> Path:
    path = folder / "run.mat"
    savemat(path, {**values_of(columns), "note": "by hand", "Ts": 1e-4}, oned_as="column")
    return path


def mat73(folder: Path, columns: Columns) -> Path:
    """As MATLAB writes it: a column is a row of the file, behind a block of 512 bytes."""
    path = folder / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in values_of(columns).items():
            file.create_dataset(name, data=values[None]).attrs["MATLAB_class"] = np.bytes_("double")
        note = file.create_dataset("note", data=np.array([[104], [105]], dtype=np.uint16))
        note.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    return path


def mdf4(folder: Path, columns: Columns) -> Path:
    """The first column becomes the times of the group, in s as always there."""
    path = folder / "run.mf4"
    (times, unit), *_ = columns.values()
    seconds = times / {"s": 1.0, "ms": 1e3}[unit]
    rest = list(columns.items())[1:]
    with MDF(version="4.10") as file:
        file.append([MdfSignal(v, seconds, unit=u, name=n) for n, (v, u) in rest])
        file.save(path, overwrite=True)
    return path


def tdms(folder: Path, columns: Columns) -> Path:
    path = folder / "run.tdms"
    objects = [
        ChannelObject("bench", name, values, properties={"unit_string": unit})
        for name, (values, unit) in columns.items()
    ]
    with TdmsWriter(path) as file:
        file.write_segment(objects)
    return path


def tdms_waveforms(folder: Path, columns: Columns) -> Path:
    """The first column becomes the increment of the waveforms, in s as always there."""
    path = folder / "run.tdms"
    (times, unit), *_ = columns.values()
    seconds = times / {"s": 1.0, "ms": 1e3}[unit]
    step = float((seconds[-1] - seconds[0]) / (len(seconds) - 1))
    objects = [
        ChannelObject("bench", name, values, properties={"unit_string": unit, "wf_increment": step})
        for name, (values, unit) in list(columns.items())[1:]
    ]
    with TdmsWriter(path) as file:
        file.write_segment(objects)
    return path


#: Writer, whether the file tells units, whether it has times of its own instead of a column.
FORMATS = {
    "csv": (csv, False, False),
    "csv with ; and decimal commas": (german_csv, True, False),
    "csv with tabulators": (tabbed_csv, False, False),
    "parquet": (parquet, False, False),
    "mat 5": (mat5, False, False),
    "mat 7.3": (mat73, False, False),
    "mdf 4": (mdf4, True, True),
    "tdms": (tdms, True, False),
    "tdms waveforms": (tdms_waveforms, True, True),
}


# --- conventions ------------------------------------------------------------------------------

POLE_PAIRS, DC_VOLTAGE = 5, 400.0
CHANNELS = ("u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el")


@pytest.fixture(scope="module")
def run():
    reference = Lissajous(200.0, 140.0, 150.0)
    return simulate(TRACTION_300A, reference, speed_rpm=900.0, duration=0.06)


def shaft_angle(run):
    """Mechanical angle in rad, starting again after a turn of the shaft."""
    return np.mod(np.unwrap(run.channels["theta_el"]) / POLE_PAIRS, 2 * np.pi)


def canonical(run):
    time = np.arange(len(run)) * run.time_step
    units = {"u": "V", "i": "A", "o": "rad/s", "t": "rad"}
    columns = {name: (run.channels[name], units[name[0]]) for name in CHANNELS}
    return {"t": (time, "s"), **columns}, {}


def odd_dq(run):
    """Foreign names and units, rms, a turned sign, the shaft's speed and angle, late voltages."""
    c, time = run.channels, np.arange(len(run)) * run.time_step
    late = {n: np.r_[[0.0, 0.0], c[n][:-2]] / 1e3 / np.sqrt(2) for n in ("u_d", "u_q")}
    columns = {
        "Zeit": (time * 1e3, "ms"),
        "Ud_soll": (late["u_d"], "kV"),
        "Uq_soll": (late["u_q"], "kV"),
        "Id": (-c["i_d"] * 1e3 / np.sqrt(2), "mA"),
        "Iq": (c["i_q"] * 1e3 / np.sqrt(2), "mA"),
        "n": (c["omega_el"] / POLE_PAIRS * 30 / np.pi, "1/min"),
        "Rotorlage": (-np.degrees(shaft_angle(run)), "°"),
    }
    mapping = {
        "t": {"column": "Zeit"},
        "u_d": {"column": "Ud_soll", "rms": True, "delay": 2},
        "u_q": {"column": "Uq_soll", "rms": True, "delay": 2},
        "i_d": {"column": "Id", "rms": True, "sign": -1},
        "i_q": {"column": "Iq", "rms": True},
        "omega_el": {"column": "n", "mechanical": True},
        "theta_el": {"column": "Rotorlage", "mechanical": True, "sign": -1},
    }
    return columns, mapping


def odd_abc(run):
    """Phase currents in mA, duties of a DC-link voltage that moves, an encoder's counts."""
    c, time = run.channels, np.arange(len(run)) * run.time_step
    currents, voltages = (
        abc_from_dq(run.stack((f"{kind}_d", f"{kind}_q")), c["theta_el"]) for kind in "iu"
    )
    dc = DC_VOLTAGE + 20 * np.sin(300 * time)
    columns = {
        "time": (time * 1e3, "ms"),
        **{f"i{p}": (currents[:, k] * 1e3, "mA") for k, p in enumerate("UVW")},
        **{f"duty{p}": (100 * (0.5 + voltages[:, k] / dc), "%") for k, p in enumerate("UVW")},
        "u_dc": (dc / 1e3, "kV"),
        "counts": (shaft_angle(run) / (2 * np.pi) * 4096, ""),
        "f_el": (c["omega_el"] / (2 * np.pi), "Hz"),
    }
    mapping = {
        "t": {"column": "time"},
        **{f"i_{a}": {"column": f"i{p}"} for a, p in zip("abc", "UVW", strict=True)},
        **{
            f"u_{a}": {"column": f"duty{p}", "times": "u_dc", "unit": "kV"}
            for a, p in zip("abc", "UVW", strict=True)
        },
        "theta_el": {"column": "counts", "unit": "turn", "scale": 1 / 4096, "mechanical": True},
        "omega_el": {"column": "f_el"},
    }
    return columns, mapping


CONVENTIONS = {"canonical": canonical, "odd dq": odd_dq, "odd abc": odd_abc}


def study(columns, mapping, told, own_times):
    """Return the text of a study file; the units stand there where the file does not tell them."""
    lines = [f"pole_pairs = {POLE_PAIRS}", "[channels]"]
    for name, entry in mapping.items():
        if name == "t" and own_times:
            continue
        unit = columns[entry["column"]][1]
        share = {"scale": 0.01} if unit == "%" and not told else {}
        given = {**({} if told else {"unit": unit}), **share, **entry}
        pairs = ", ".join(f"{key} = {json.dumps(value)}" for key, value in given.items())
        lines.append(f"{name} = {{ {pairs} }}")
    return "\n".join(lines)


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("kind", FORMATS)
def test_every_file_gives_the_same_recording(run, kind, convention, tmp_path):
    write, told, own_times = FORMATS[kind]
    columns, mapping = CONVENTIONS[convention](run)
    path, config = write(tmp_path, columns), tmp_path / "study.toml"
    config.write_text(study(columns, mapping, told, own_times))
    read = drive_recording(load_study(config if mapping else None).load(path))

    rows = len(run) - 2 if convention == "odd dq" else len(run)  # late by two: two rows less
    assert len(read) == rows
    assert read.time_step == pytest.approx(run.time_step, rel=1e-12)
    for name in CHANNELS[:5]:
        expected = run.channels[name][:rows]
        atol = 1e-12 * np.abs(expected).max()
        np.testing.assert_allclose(read.channels[name], expected, rtol=0, atol=atol, err_msg=name)
    turned = read.channels["theta_el"] - run.channels["theta_el"][:rows]
    np.testing.assert_allclose(np.sin(turned), 0.0, atol=1e-12)
    assert np.cos(turned).min() > 0


# --- the same numbers at the end ------------------------------------------------------------------


@pytest.fixture(scope="module")
def trained():
    reference = Lissajous(200.0, 140.0, 150.0)
    return simulate(TRACTION_300A, reference, speed_rpm=900.0, duration=0.1)


@pytest.fixture(scope="module")
def reference(trained):
    """Return the numbers of the recording that never was a file."""
    study = Study(horizon=1, candidates=(), angle_orders=(), pole_pairs=POLE_PAIRS)
    return numbers_in(identify([trained], study=study).result())


def numbers_in(result):
    """Return what was found, number by number: parameters, ladder and errors."""
    found = {"parameters": result["parameters"], "ladder": result["horizon"]["ladder"]}
    found["metrics"] = list(result["metrics"]["train"].values())
    return dict(leaves(json.loads(json.dumps(found)), ""))


def leaves(part, path):
    if isinstance(part, (dict, list)):
        items = part.items() if isinstance(part, dict) else enumerate(part)
        for key, value in items:
            yield from leaves(value, f"{path}/{key}")
    elif isinstance(part, (int, float)):
        yield path, part


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    ["csv with ; and decimal commas", "parquet", "mat 5", "mat 7.3", "mdf 4", "tdms"],
)
def test_every_file_gives_the_same_result(trained, reference, kind, tmp_path):
    """Phases in mA, duties, an encoder's counts on the shaft: in result.json it does not show."""
    write, told, own_times = FORMATS[kind]
    columns, mapping = odd_abc(trained)
    path, config = write(tmp_path, columns), tmp_path / "study.toml"
    options = ["horizon = 1", "inverter = false", "angle_orders = []"]
    config.write_text("\n".join([*options, study(columns, mapping, told, own_times)]))
    asked = load_study(config)
    found = numbers_in(identify([asked.load(path)], study=asked.study).result())
    assert found == pytest.approx(reference, rel=1e-9, abs=0)
