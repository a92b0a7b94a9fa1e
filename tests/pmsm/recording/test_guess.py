"""A guessed study file is right as it stands, or says what it does not know."""

import tomllib
from itertools import pairwise

import numpy as np
import pytest
from asammdf import MDF
from asammdf import Signal as MdfSignal
from scipy.io import savemat

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.load import read
from penode.data.table import Table
from penode.pmsm.machine.frames import abc_from_dq
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.recording.guess import guess_study
from penode.pmsm.recording.guess_names import read_name
from penode.pmsm.recording.study_text import study_text
from penode.pmsm.study_file import load_study

POLE_PAIRS = 5


@pytest.fixture(scope="module")
def run():
    reference = Lissajous(200.0, 140.0, 150.0)
    return simulate(TRACTION_300A, reference, speed_rpm=900.0, duration=0.1)


def time_of(run):
    return np.arange(len(run)) * run.time_step


def shaft_angle(run):
    return np.mod(np.unwrap(run.channels["theta_el"]) / POLE_PAIRS, 2 * np.pi)


def rpm(run):
    return run.channels["omega_el"] / POLE_PAIRS * 30 / np.pi


# --- three files as they come -----------------------------------------------------------------


def german_csv(run, folder):
    c, path = run.channels, folder / "pruefstand.csv"
    head = [
        "Zeit;Strom_d;Strom_q;Spannung_d_Soll;Spannung_q_Soll;Drehzahl;Rotorlage_el;Temp_Wicklung"
    ]
    head.append("ms;A;A;V;V;1/min;°;°C")
    values = (time_of(run) * 1e3, c["i_d"], c["i_q"], c["u_d"], c["u_q"], rpm(run))
    table = np.stack([*values, np.degrees(c["theta_el"]), 20 + time_of(run)], axis=1)
    rows = [";".join(f"{x!r}".replace(".", ",") for x in row) for row in table.tolist()]
    path.write_text("\n".join(head + rows) + "\n")
    return path


def phase_mat(run, folder):
    c, path = run.channels, folder / "log.mat"
    currents, voltages = (
        abc_from_dq(run.stack((f"{kind}_d", f"{kind}_q")), c["theta_el"]) for kind in "iu"
    )
    log = {
        "time": time_of(run),
        **{f"I{p}": currents[:, k] for k, p in enumerate("abc")},
        **{f"V{p}": voltages[:, k] for k, p in enumerate("abc")},
        "Vdc": np.full(len(run), 400.0),
        "theta": shaft_angle(run),
        "speed_rpm": rpm(run),
        "torque": c["i_q"],
    }
    savemat(path, {"log": log, "Ts": run.time_step})
    return path


def two_rate_mdf(run, folder):
    c, path, fast = run.channels, folder / "bench.mf4", time_of(run)
    names = {"id_meas": "i_d", "iq_meas": "i_q", "id_ref": "i_d", "ud_ref": "u_d", "uq_ref": "u_q"}
    units = {"i": "A", "u": "V"}
    with MDF(version="4.10") as file:
        file.append([MdfSignal(c[v], fast, unit=units[v[0]], name=n) for n, v in names.items()])
        slow = {"omega": ("omega_el", "rad/s"), "theta": ("theta_el", "rad")}
        file.append(
            [MdfSignal(c[v][::10], fast[::10], unit=u, name=n) for n, (v, u) in slow.items()]
        )
        file.save(path, overwrite=True)
    return path


def phases_of(run, kind):
    return abc_from_dq(run.stack((f"{kind}_d", f"{kind}_q")), run.channels["theta_el"])


def logger(folder, columns):
    path = folder / "log.csv"
    rows = "\n".join(",".join(map(repr, row)) for row in np.stack([*columns.values()], 1).tolist())
    path.write_text(f"{','.join(columns)}\n{rows}\n")
    return path


def drive_log(run, folder):
    """Two currents, duty cycles in %, the angle of the shaft and no speed."""
    currents, voltages = phases_of(run, "i"), phases_of(run, "u")
    link = 380 + 5 * np.sin(time_of(run))
    columns = {"t_us": time_of(run) * 1e6, "iU": currents[:, 0], "iV": currents[:, 1]}
    columns |= {f"PWM_{p}": 50 + 100 * voltages[:, k] / link for k, p in enumerate("UVW")}
    return logger(
        folder, columns | {"Vdc": link, "rotor_position_deg": np.degrees(shaft_angle(run))}
    )


def simulator_log(run, folder):
    """Axes alpha and beta of the currents, modulation from -1 to 1."""
    currents, voltages = phases_of(run, "i"), phases_of(run, "u")
    beta = (currents[:, 1] - currents[:, 2]) / np.sqrt(3)
    columns = {"time": time_of(run), "i_alpha": currents[:, 0], "i_beta": beta}
    columns |= {f"mod_{p}": voltages[:, k] / 200 for k, p in enumerate("abc")}
    columns |= {"Udc": np.full(len(run), 400.0), "omega_e": run.channels["omega_el"]}
    return logger(folder, columns | {"theta_e": run.channels["theta_el"]})


def scope_log(run, folder):
    """Voltages from line to line."""
    currents, voltages = phases_of(run, "i"), phases_of(run, "u")
    lines = voltages - np.roll(voltages, -1, axis=1)
    columns = {"Time (s)": time_of(run), "Phase A Current (A)": currents[:, 0]}
    columns |= {"Phase C Current (A)": currents[:, 2]}
    columns |= {"V_UV": lines[:, 0], "V_VW": lines[:, 1], "theta_el": run.channels["theta_el"]}
    return logger(folder, columns)


FILES = {
    "German CSV": german_csv,
    "phases in MAT": phase_mat,
    "two rates in MDF": two_rate_mdf,
    "log of a drive": drive_log,
    "log of a simulator": simulator_log,
    "log of an oscilloscope": scope_log,
}


@pytest.mark.parametrize("kind", FILES)
def test_the_study_file_maps_the_recording_untouched(run, kind, tmp_path):
    path, config = FILES[kind](run, tmp_path), tmp_path / "study.toml"
    config.write_text(study_text(guess_study(read(path)[0]), path.name, config.name))
    read_back = drive_recording(load_study(config).load(path))
    assert len(read_back) >= len(run) - 10  # the slow group ends up to nine samples earlier
    for name in ("i_d", "i_q", "u_d", "u_q"):
        expected = run.channels[name][: len(read_back)]
        atol = 1e-9 * np.abs(expected).max()
        np.testing.assert_allclose(read_back.channels[name], expected, rtol=0, atol=atol)
    speed, expected = (e.channels["omega_el"][: len(read_back)] for e in (read_back, run))
    atol = 1e-9 if "log of" not in kind else 1e-3  # some logs have the angle only
    np.testing.assert_allclose(speed, expected, rtol=0, atol=atol * expected.max())
    turned = read_back.channels["theta_el"] - run.channels["theta_el"][: len(read_back)]
    np.testing.assert_allclose(np.exp(1j * turned), 1.0, atol=1e-6)


@pytest.mark.parametrize("kind", FILES)
def test_every_line_of_it_says_that_it_is_a_guess_or_a_default(run, kind, tmp_path):
    path = FILES[kind](run, tmp_path)
    text = study_text(guess_study(read(path)[0]), path.name, "study.toml")
    lines = text.splitlines()
    for above, line in pairwise(lines):
        if line and not line.startswith(("#", "[")):
            assert above.startswith("# guess: ") or "# guess: " in line or "# default" in line
    assert tomllib.loads(text)["channels"]


# --- what the numbers tell --------------------------------------------------------------------


def guess(run, **columns):
    c = run.channels
    dq = {"id": c["i_d"], "iq": c["i_q"], "ud": c["u_d"], "uq": c["u_q"]}
    return guess_study(Table({"time": time_of(run), **dq, **columns}))


def test_columns_in_a_unit_of_temperature_are_told_apart(run):
    one = np.full(len(run), 60.0)
    found = guess(run, **{"Tw [°C]": one, "T_oil (K)": one, "Zeug [V]": one})
    assert found.heat == {"Tw [°C]": "degC", "T_oil (K)": "K"}


@pytest.mark.parametrize(
    ("name", "factor", "unit", "mechanical"),
    [
        ("speed", 1.0, "rad/s", False),
        ("speed", 1 / POLE_PAIRS, "rad/s", True),
        ("speed", 30 / np.pi / POLE_PAIRS, "rpm", True),
        ("omega", 30 / np.pi / POLE_PAIRS, "rpm", True),
        ("omega", 1 / (2 * np.pi), "Hz", False),
    ],
)
def test_unit_and_side_of_the_speed_come_from_the_angle(run, name, factor, unit, mechanical):
    c = run.channels
    found = guess(run, **{name: factor * c["omega_el"], "theta": c["theta_el"]})
    speed = found.channels["omega_el"]
    assert (speed.unit, speed.mechanical) == (unit, mechanical)
    assert found.pole_pairs == (POLE_PAIRS if mechanical else None)
    assert not found.lacks_pole_pairs


@pytest.mark.parametrize(
    ("name", "unit"), [("we", "rad/s"), ("log.we", "rad/s"), ("w.n", "rpm"), ("log/omega", "rad/s")]
)
def test_without_an_angle_the_unit_of_the_speed_is_that_of_such_names(run, name, unit):
    found = guess(run, **{name: run.channels["omega_el"]}).channels["omega_el"]
    assert (found.column, found.unit) == (name, unit)


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360.0), ("turn", 1.0), ("rad", 2 * np.pi)])
def test_unit_of_the_angle_comes_from_its_range(run, unit, turn):
    c = run.channels
    angle = c["theta_el"] / (2 * np.pi) * turn
    found = guess(run, omega=c["omega_el"], theta=angle - turn / 2)
    assert found.channels["theta_el"].unit == unit


def test_an_angle_that_counts_backwards_is_turned(run):
    c = run.channels
    found = guess(run, omega=c["omega_el"], theta=-c["theta_el"])
    assert found.channels["theta_el"].sign == -1
    assert found.channels["omega_el"].sign == 1


def test_phases_tell_that_the_speed_counts_backwards(run, tmp_path):
    table, _ = read(phase_mat(run, tmp_path))
    table.columns["log.speed_rpm"] = -table.columns["log.speed_rpm"]
    found = guess_study(table)
    assert found.channels["theta_el"].sign == 1
    assert found.channels["omega_el"].sign == -1


def test_pole_pairs_that_cannot_be_told_are_asked_for(run):
    found = guess(run, n_mech=rpm(run))
    assert found.channels["omega_el"].mechanical
    assert found.lacks_pole_pairs
    assert "# pole_pairs =" in study_text(found, "run.csv", "study.toml")


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_unit_of_the_time_comes_from_the_step(run, factor, unit):
    columns = {"time": time_of(run) * factor}
    assert guess(run, **columns, n=rpm(run)).channels["t"].unit == unit


@pytest.mark.parametrize("rows", [0, 1])
def test_names_alone_decide_where_there_are_no_rows(rows):
    names = ("time", "Id", "Iq", "ud", "uq", "n", "theta_deg")
    found = guess_study(Table({name: np.zeros(rows) for name in names}))
    units = [guess.unit for guess in found.channels.values()]
    assert units == ["s", "V", "V", "A", "A", "rpm", "deg"]
    assert found.channels["omega_el"].mechanical


def per_unit(run):
    c = run.channels
    scales = {"id": 1 / 300, "iq": 1 / 300, "ud": 1 / 230, "uq": 1 / 230}
    return {name: f * c[f"{name[0]}_{name[1]}"] for name, f in scales.items()}


@pytest.mark.parametrize("said_by", ["name", "file", "size"])
def test_what_is_per_unit_asks_for_its_bases(run, said_by, tmp_path):
    columns = per_unit(run)
    if said_by == "name":
        columns = {f"{name}_pu": values for name, values in columns.items()}
    columns = {"time": time_of(run), **columns, "w": run.channels["omega_el"]}
    units = dict.fromkeys(columns, "p.u.") if said_by == "file" else {}
    table = Table(columns, {n: u for n, u in units.items() if n not in ("time", "w")})
    found = guess_study(table)
    assert found.bases == ("u_base", "i_base")
    assert {found.channels[name].unit for name in ("u_d", "u_q", "i_d", "i_q")} == {"1"}
    text = study_text(found, "run.csv", "study.toml")
    assert "# not found, and needed: i_base, what 1 is in A of a column per unit.\n" in text
    text = text.replace("# u_base =", "u_base = 230").replace("# i_base =", "i_base = 300")
    config = tmp_path / "study.toml"
    config.write_text(text)
    read_back = load_study(config).load(logger(tmp_path, columns))
    for name in ("i_d", "i_q", "u_d", "u_q", "omega_el"):
        np.testing.assert_allclose(read_back.channels[name], run.channels[name], atol=1e-9)


def test_a_small_machine_with_units_is_not_per_unit(run):
    columns = {"time": time_of(run), **per_unit(run), "n": rpm(run)}
    found = guess_study(Table(columns, {"id": "A"}))
    assert found.bases == ()
    assert {found.channels[name].unit for name in ("u_d", "i_q")} == {"V", "A"}


def test_duties_without_their_link_ask_for_it(run, tmp_path):
    table, _ = read(drive_log(run, tmp_path))
    del table.columns["Vdc"]
    found = guess_study(table)
    assert found.missing == ("u_dc",)
    text = study_text(found, "log.csv", "study.toml")
    assert "# not found, and needed, as a column or as a number: u_dc in V.\n# u_dc =\n" in text
    config = tmp_path / "study.toml"
    config.write_text(text.replace("# u_dc =\n", "u_dc = 380\n"))
    assert "u_dc" in load_study(config).load(tmp_path / "log.csv").channels


@pytest.mark.parametrize("volts", [400.0, 0.0])
def test_a_link_beside_voltages_is_one_only_above_them(run, volts):
    columns = {n: run.channels[n] for n in ("u_d", "u_q", "i_d", "i_q", "omega_el")}
    link = {"Vdc": np.full(len(run), volts)}
    found = guess_study(Table({"t": run.time_step * np.arange(len(run)), **columns, **link}, {}))
    assert ("u_dc" in found.channels, "Vdc" in found.unused) == (volts > 0, volts == 0)


def test_an_angle_with_a_gap_in_it_tells_nothing_and_breaks_nothing(run):
    theta = run.channels["theta_el"].copy()
    theta[7] = np.nan
    found = guess(run, speed=run.channels["omega_el"], theta=theta)
    assert found.channels["omega_el"].unit == "rpm"
    assert "usual" in found.channels["omega_el"].reasons[-1]


def test_what_is_missing_is_said(run):
    found = guess_study(Table({"time": time_of(run), "Id": run.channels["i_d"]}))
    assert found.missing == ("u_d", "u_q", "i_q", "omega_el")
    text = study_text(found, "run.csv", "study.toml")
    assert "not found, and needed: i_q in A" in text
    assert list(tomllib.loads(text)["channels"]) == ["t", "i_d"]


def test_nothing_at_all_is_found_in_a_foreign_file():
    found = guess_study(Table({"a": np.zeros(9), 'b"c': np.zeros(9)}))
    assert not found.channels
    tomllib.loads(study_text(found, "run.csv", "study.toml"))


def test_a_reference_is_no_current_but_a_voltage(run):
    found = guess(run, id_ref=run.channels["i_d"], ud_ref=run.channels["u_d"], n=rpm(run))
    assert found.channels["i_d"].column == "id"
    assert found.channels["u_d"].column == "ud_ref"
    assert found.unused == ("ud", "id_ref")
    assert "before ud" in found.channels["u_d"].reasons[0]


def test_a_unit_that_the_file_tells_rules_a_name_out(run):
    table = Table({"t": time_of(run), "n": rpm(run), "w": rpm(run)}, {"n": "V", "w": "rpm"})
    assert guess_study(table).channels["omega_el"].column == "w"


# --- names ------------------------------------------------------------------------------------

NAMES = {
    "t": ["t", "time_s", "Zeit [ms]", "t_us", "t_stamp", "Time (s)"],
    "i_d": [
        "i_d",
        "Id",
        "id_A",
        "Strom_d",
        "Strom d (A)",
        "d-Achsen-Strom",
        "i_sd",
        "IDRef",
        "idmeas",
        "idist",
        "Ids",
    ],
    "i_q": ["iq_meas", "IqIst", "log.i_q", "fast/Iq", "Stator Current q", "iqact", "iqmeas", "Iqs"],
    "u_d": ["ud_ref", "vd", "usd", "Umrichterspannung_d", "u_d_V", "Udref", "Uds", "udcmd"],
    "u_q": ["Spannung_q_V", "UqSoll", "VqRef", "Spannung q", "Uqs", "uqsoll", "vqs"],
    "i_a": ["ia", "Ia", "I_U", "i_u", "i_A", "I1", "Phase A Current (A)", "Phasenstrom_a"],
    "u_b": ["Vb", "u_V", "U_B [V]"],
    "u_alpha": ["u_alpha", "uAlpha", "v_al", "Spannung alpha [V]"],
    "i_beta": ["ibeta", "I_beta_A", "iBetaMeas"],
    "u_ab": ["u_ab", "Uab", "V_UV", "Voltage UV (V)"],
    "duty_a": ["dutyA", "duty_u", "PWM1", "d_a", "Tastgrad_U [%]", "mod_a", "DutyCycle_A"],
    "u_dc": ["Udc", "u_dc", "Vdc_V", "U_ZK", "Zwischenkreisspannung", "DC link voltage", "Vbus"],
    "omega_el": [
        "n",
        "n_mech",
        "speed_rpm",
        "omegaEl",
        "Drehzahl [1/min]",
        "Motor Speed",
        "w_el",
        "nist",
        "nact",
    ],
    "winding_temperature": [
        "T_winding",
        "T_wdg_C",
        "TempStator",
        "Wicklungstemperatur",
        "temp_coil [°C]",
    ],
    "magnet_temperature": ["TempMagnet", "magnet_temperature", "Magnettemperatur", "T_magnet_K"],
    "theta_el": ["theta", "theta_mech", "Rotorlage_Grad", "position_deg", "phi_el [rad]"],
}


@pytest.mark.parametrize("channel", NAMES)
def test_names(channel):
    for name in NAMES[channel]:
        hint = read_name(name)
        assert hint is not None, name
        assert hint.channel == channel, name


#: Names that loggers of motor controls give, and the channel of each.
LOGGERS = {
    "VESC": ("d_axis_current", "q_axis_current", "d_axis_voltage", "q_axis_voltage", "erpm"),
    "ODrive": ("foc.Id_measured", "foc.Iq_measured", "foc.Vd_setpoint", "foc.Vq_setpoint",
               "axis0.motor.foc.phase_vel"),
    "moteus": ("servo_stats.d_A", "servo_stats.q_A", "servo_control.d_V", "servo_control.q_V",
               "servo_stats.velocity"),
    "TI": ("motorVars_M1.Idq_in_A.value[0]", "motorVars_M1.Idq_in_A.value[1]",
           "motorVars_M1.Vdq_out_V.value[0]", "motorVars_M1.Vdq_out_V.value[1]",
           "motorVars_M1.speed_Hz"),
}  # fmt: skip


@pytest.mark.parametrize("logger", LOGGERS)
def test_names_of_loggers(logger):
    found = [read_name(name).channel for name in LOGGERS[logger]]
    assert found == ["i_d", "i_q", "u_d", "u_q", "omega_el"]


@pytest.mark.parametrize(
    ("name", "asked_for"),
    [("torque_Nm", False), ("M (Nm)", False), ("Drehmoment", False), ("torque_ref", True)],
)
def test_a_torque_by_name_or_unit(name, asked_for):
    hint = read_name(name)
    assert (hint.channel, hint.asked_for) == ("torque", asked_for)


@pytest.mark.parametrize("name", ["phase", "axis0.encoder.phase"])
def test_a_phase_alone_is_the_angle(name):
    assert read_name(name).channel == "theta_el"


@pytest.mark.parametrize(
    "name",
    [
        *("Idc", "DC current", "Temp_rotor", "I_max", "torque_max", "t_amb"),
        *("T_oil", "TempInverter", "temperature", "list", "exact", "idset_max"),
        *("idq", "iab", "duty_q", "duty", "bus", "17", ""),
    ],
)
def test_names_of_something_else(name):
    assert read_name(name) is None


@pytest.mark.parametrize(
    ("name", "unit", "side", "asked_for"),
    [
        ("id_A", "A", "", False),
        ("Drehzahl [1/min]", "rpm", "", False),
        ("n_mech", "", "mechanical", False),
        ("omegaEl", "", "electrical", False),
        ("speed_el_rad/s", "rad/s", "electrical", False),
        ("Id*", "", "", True),
        ("n_soll", "", "", True),
        ("servo_stats.q_A", "A", "", False),
        ("motorVars_M1.Idq_in_A.value[0]", "A", "", False),
        ("motorVars_M1.IdqRef_A.value[1]", "A", "", True),
        ("axis0.motor.foc.Vd_setpoint", "", "", True),
        ("axis0.motor.foc.phase_vel", "", "electrical", False),
        ("erpm", "", "electrical", False),
    ],
)
def test_what_else_a_name_says(name, unit, side, asked_for):
    hint = read_name(name)
    assert (hint.unit, hint.side, hint.asked_for) == (unit, side, asked_for)
