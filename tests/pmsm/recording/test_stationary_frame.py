"""What drives log in place of dq quantities comes back as these, through a study file."""

import numpy as np
import pytest

from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.pmsm.conventions.check import check_conventions
from penode.pmsm.recording.channels import drive_recording, missing_channels
from penode.pmsm.recording_check import check_recordings
from penode.pmsm.study_file import load_study

DQ = ("u_d", "u_q", "i_d", "i_q", "omega_el")
LINK = 400.0


@pytest.fixture(scope="module")
def run(unseen_run):
    names = (*DQ, "theta_el")
    return Experiment("run", 1e-4, {name: unseen_run.channels[name][:1500] for name in names})


def logged(run):
    """Return what sensors and a controller see, by complex numbers and cosines written out."""
    c, theta = run.channels, run.channels["theta_el"]
    link = LINK + 20 * np.sin(70 * np.arange(len(run)) * run.time_step)
    seen = {"t": np.arange(len(run)) * run.time_step, "theta_el": theta, "link": link}
    for kind in "ui":
        turning = (c[f"{kind}_d"] + 1j * c[f"{kind}_q"]) * np.exp(1j * theta)
        a, b, c_ = (np.real(turning * np.exp(-2j * np.pi / 3 * k)) for k in range(3))
        seen |= {f"{kind}_a": a, f"{kind}_b": b, f"{kind}_c": c_}
        seen |= {f"{kind}_alpha": turning.real, f"{kind}_beta": turning.imag}
        seen |= {f"{kind}_ab": a - b, f"{kind}_bc": b - c_, f"{kind}_ca": c_ - a}
    # A third harmonic in all three phases, which the machine never sees.
    third = 0.1 * np.cos(3 * theta)
    for phase in "abc":
        share = seen[f"u_{phase}"] / link
        seen[f"duty_{phase}"] = 0.5 + share + third
        seen[f"index_{phase}"] = 2 * (share + third)
    return seen | {"omega_el": c["omega_el"]} | {name: c[name] for name in DQ[:4]}


def entries(*names):
    return "".join(f'{name} = "{name}"\n' for name in names)


CURRENTS, ANGLE = entries("i_a", "i_b", "i_c"), entries("t", "theta_el")
VOLTAGES = entries("u_a", "u_b", "u_c")
DUTIES, LINKED = entries("duty_a", "duty_b", "duty_c"), 'u_dc = "link"\n'
CHANNELS = {
    "alpha and beta": entries("u_alpha", "u_beta", "i_alpha", "i_beta"),
    "two currents a, b": VOLTAGES + entries("i_a", "i_b"),
    "two currents b, c": VOLTAGES + entries("i_b", "i_c"),
    "two currents c, a": VOLTAGES + entries("i_a", "i_c"),
    "line to line ab, bc": CURRENTS + entries("u_ab", "u_bc"),
    "line to line bc, ca": CURRENTS + entries("u_bc", "u_ca"),
    "line to line ca, ab": CURRENTS + entries("u_ab", "u_ca"),
    "duty from 0 to 1": CURRENTS + DUTIES + LINKED,
    "duty from -1 to 1": CURRENTS
    + "".join(f'duty_{p} = {{ column = "index_{p}", scale = 0.5 }}\n' for p in "abc")
    + LINKED,
    "currents in dq": entries("i_d", "i_q", "u_alpha", "u_beta"),
}


def written(folder, columns, study):
    """Return the recording that a study file makes of columns."""
    recording, config = folder / "run.csv", folder / "study.toml"
    rows = np.column_stack(list(columns.values()))
    np.savetxt(recording, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    config.write_text(study)
    return load_study(config).load(recording)


def assert_same(found, run, names=DQ):
    for name in names:
        atol = 1e-9 * np.abs(run.channels[name]).max()
        np.testing.assert_allclose(
            found.channels[name], run.channels[name], rtol=0, atol=atol, err_msg=name
        )


@pytest.mark.parametrize("form", CHANNELS)
def test_every_form_gives_the_dq_quantities(run, form, tmp_path):
    text = f"[channels]\n{ANGLE}{entries('omega_el')}{CHANNELS[form]}"
    assert_same(drive_recording(written(tmp_path, logged(run), text)), run)


@pytest.mark.parametrize("form", CHANNELS)
def test_names_of_the_channels_need_no_study_file(run, form, tmp_path):
    columns = logged(run)
    columns["u_dc"] = columns.pop("link")
    scaled = {name: columns[f"index_{name[-1]}"] / 2 for name in columns if name[:5] == "duty_"}
    columns |= scaled if "-1" in form else {}
    named = [line.split(" = ")[0] for line in CHANNELS[form].splitlines()]
    kept = {name: columns[name] for name in ("t", "theta_el", "omega_el", *named)}
    assert_same(drive_recording(written(tmp_path, kept, "")), run)


def test_a_constant_dc_link(run, tmp_path):
    columns = logged(run)
    for phase in "abc":
        columns[f"duty_{phase}"] = 0.5 + columns[f"u_{phase}"] / LINK
    text = f"u_dc = 400\n[channels]\n{ANGLE}{entries('omega_el')}{CURRENTS}{DUTIES}"
    assert_same(drive_recording(written(tmp_path, columns, text)), run)
    with pytest.raises(InputError, match=r"u_dc is a number \(400\) and a channel; remove one\."):
        written(tmp_path, columns, text + LINKED)


def test_fractions_of_bases(run, tmp_path):
    c = run.channels
    columns = logged(run) | {"u_d": c["u_d"] / 230, "u_q": 100 * c["u_q"] / 230}
    columns |= {name: c[name] / 320 for name in ("i_d", "i_q")}
    columns["omega_el"] = c["omega_el"] / (5 * 400)
    bases = "pole_pairs = 5\nu_base = 230\ni_base = 320.0\nomega_base = 400\n[channels]\n"
    text = bases + entries("t", "theta_el", "u_d", "i_d")
    text += 'i_q = { column = "i_q", unit = "p.u." }\nu_q = { column = "u_q", unit = "%" }\n'
    text += 'omega_el = { column = "omega_el", mechanical = true }\n'
    assert_same(written(tmp_path, columns, text), run)
    columns |= {"u_q": c["u_q"] / 230, "omega_el": c["omega_el"] / 2000}
    text = "u_base = 230\ni_base = 320\nomega_base = 2000\n"
    assert_same(written(tmp_path, {n: columns[n] for n in ("t", *DQ)}, text), run)


@pytest.mark.parametrize(
    ("study", "words"),
    [
        (
            '[channels]\ni_d = { column = "i_d", unit = "pu" }\n',
            ["channel i_d: column i_d is per unit (pu)", "add i_base, what 1 is in A"],
        ),
        (
            'u_base = 230\n[channels]\nu_d = { column = "u_d", unit = "V" }\n',
            ["channel u_d: column u_d has unit 'V' beside u_base", 'unit = "1"'],
        ),
        ("u_base = 0\n", ["u_base must be a finite number > 0, got 0"]),
    ],
)
def test_a_base_too_few_or_too_many_is_refused(run, study, words, tmp_path):
    named = [name for name in ("t", *DQ) if f"\n{name} = " not in study]
    text = study + (entries(*named) if "[channels]" in study else "")
    with pytest.raises(InputError) as refusal:
        written(tmp_path, logged(run), text)
    for word in words:
        assert word in str(refusal.value)


@pytest.mark.parametrize(
    ("present", "missing"),
    [
        (("u_alpha", "i_alpha", "i_beta", "theta_el"), ["u_beta"]),
        (("u_ab", "i_a", "theta_el"), ["u_bc", "i_b"]),
        (("duty_a", "duty_b", "duty_c", "i_a", "i_b", "theta_el"), ["u_dc"]),
        (("u_d", "u_q", "i_b", "i_c", "u_dc"), ["theta_el"]),
        (("u_dc", "omega_el"), ["u_d", "u_q", "i_d", "i_q"]),
    ],
)
def test_what_is_missing_is_the_rest_of_the_form_that_is_there(present, missing):
    assert missing_channels(present) == missing


def test_conventions_are_judged_in_every_form(run):
    """An axis beta that counts the other way, which is two phases exchanged."""
    columns = logged(run)
    names = ("theta_el", "omega_el", "u_alpha", "u_beta", "i_alpha", "i_beta")
    good = Experiment("run", 1e-4, {name: columns[name] for name in names})
    assert check_conventions(good).broken == ()
    turned = {name: -columns[name] for name in ("u_beta", "i_beta")}
    broken = check_conventions(Experiment("run", 1e-4, {**good.channels, **turned})).broken
    assert [finding.name for finding in broken] == ["swapped phases"]
    assert broken[0].fix.startswith("give u_beta and i_beta sign = -1, or give theta_el")


def test_two_currents_and_duties_pass_the_check(run):
    columns = logged(run)
    names = ("theta_el", "omega_el", "duty_a", "duty_b", "duty_c", "i_a", "i_b")
    channels = {name: columns[name] for name in names} | {"u_dc": np.full(len(run), LINK)}
    found = check_recordings([Experiment("run", 1e-4, channels)])
    assert found.quality == ()
    assert found.broken == ()
