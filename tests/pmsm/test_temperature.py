"""R over a recorded winding temperature: found, asked for by its word, refused without its channel.

The drive warms its own winding: R rises by a fifth while it is recorded.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from penode.bench.drive import Drive
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import record, simulate
from penode.bench.winding import Warming, Winding
from penode.cli.main import app
from penode.data.save import save
from penode.errors import InputError
from penode.pmsm.machine.temperatures import temperatures_of
from penode.pmsm.machine.terms import MagnetTemperature, TemperatureResistance
from penode.pmsm.study import identify
from penode.pmsm.study_file import load_study
from penode.pmsm.study_settings import Study

ALPHA = TRACTION_300A.copper_coefficient


@pytest.fixture(scope="module")
def warming_run():
    """1500 rpm, 240 A, 0.5 s: from 40 degC to about 100 degC."""
    winding = Winding(40.0, warming=Warming(heat_capacity=6.0, thermal_resistance=1.0))
    made = record(
        TRACTION_300A,
        Lissajous(240.0, 50.0, 43.0),
        speed_rpm=1500.0,
        duration=0.5,
        drive=Drive(winding=winding),
    )
    temperature = made.truth.trace.temperature[: len(made.experiment)]
    channels = {**made.experiment.channels, "winding_temperature": temperature}
    return replace(made.experiment, name="warming.csv", channels=channels)


def test_the_recording_warms(warming_run):
    temperature = warming_run.channels["winding_temperature"]
    assert temperature[0] == pytest.approx(40.0, abs=1.0)
    assert temperature[-1] - temperature[0] > 50.0


@pytest.mark.slow
def test_the_resistance_at_20_degrees_is_found(warming_run):
    terms = (TemperatureResistance(alpha=ALPHA),)
    study = Study(horizon=3, terms=terms, candidates=(), angle_orders=(6, 12))
    fit = identify([warming_run], study=study)
    estimate = fit.parameters["R"]
    truth = TRACTION_300A.resistance_at(20.0)
    assert estimate.value == pytest.approx(truth, rel=1e-3)
    assert estimate.statistical_std < 2e-3 * truth
    assert estimate.meaning == "stator resistance at 20 °C"
    assert fit.provenance["terms"] == ["temperature_resistance", "Rotation"]
    plain = identify([warming_run], study=replace(study, terms=()))
    middle = float(np.mean(warming_run.channels["winding_temperature"]))
    assert plain.parameters["R"].value > 1.1 * truth
    assert plain.parameters["R"].value == pytest.approx(
        truth * (1 + ALPHA * (middle - 20)), rel=0.03
    )
    assert fit.comparisons[0].free_run_rmse < 0.3 * plain.comparisons[0].free_run_rmse


@pytest.mark.slow
@pytest.mark.parametrize("told", ["option", "study file"])
def test_the_word_does_it_from_the_command_line(warming_run, tmp_path, told):
    """A log in kelvin under a name of its own: the study file maps it."""
    channels = dict(warming_run.channels)
    channels["T_wdg"] = channels.pop("winding_temperature") + 273.15
    short = {name: values[:3000] for name, values in channels.items()}
    save(replace(warming_run, channels=short), tmp_path / "run.csv")
    names = ("t", "u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el")
    lines = ["inverter = false", "angle_orders = []"]
    lines += ['terms = ["temperature_resistance"]'] if told == "study file" else []
    lines += ["[channels]", *(f'{name} = "{name}"' for name in names)]
    lines.append('winding_temperature = { column = "T_wdg", unit = "K" }')
    (tmp_path / "study.toml").write_text("\n".join(lines) + "\n")
    command = ["identify", str(tmp_path / "run.csv"), "--config", str(tmp_path / "study.toml")]
    command += ["--horizon", "1", "--out", str(tmp_path / "out")]
    command += ["--terms", "temperature_resistance"] if told == "option" else []
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    written = json.loads((tmp_path / "out" / "result.json").read_text())
    assert written["provenance"]["terms"][0] == "temperature_resistance"
    assert written["parameters"]["R"]["meaning"] == "stator resistance at 20 °C"
    truth = TRACTION_300A.resistance_at(20.0)
    assert written["parameters"]["R"]["value"] == pytest.approx(truth, rel=0.05)
    mean = float(np.mean(short["T_wdg"])) - 273.15
    assert written["provenance"]["recorded_temperatures"]["winding_temperature"][0] == (
        pytest.approx(mean)
    )


def test_a_missing_temperature_is_refused_in_a_sentence(slow_run):
    with pytest.raises(InputError) as refusal:
        identify([slow_run], study=Study(terms=(TemperatureResistance(),)))
    assert str(refusal.value) == (
        f"{slow_run.name}: channel winding_temperature is missing; the resistance over "
        "temperature needs the temperature of the winding in degC: record it, or identify without."
    )


def test_a_temperature_in_kelvin_is_refused_in_a_sentence(warming_run):
    kelvin = warming_run.channels["winding_temperature"] + 273.15
    channels = {**warming_run.channels, "winding_temperature": kelvin}
    wrong = replace(warming_run, channels=channels)
    with pytest.raises(InputError) as refusal:
        identify([wrong], study=Study(terms=(TemperatureResistance(),)))
    assert str(refusal.value) == (
        "warming.csv: data row 1, channel winding_temperature is 313.15 where the temperature of "
        "the winding lies between -60 and 300 degC; check its column and unit in the study file."
    )


def test_words_of_the_study_file(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('terms = ["temperature_resistance"]\ninverter = true\n')
    study = load_study(path).study
    assert [type(term).__name__ for term in study.terms] == ["TemperatureResistance", "DeadTime"]
    assert study.candidates == ()
    again = load_study(path, {"terms": ["resistance"], "inverter": False}).study
    assert [type(term).__name__ for term in again.terms] == ["Resistance"]
    path.write_text('terms = ["temperature"]\n')
    with pytest.raises(InputError, match="unknown term 'temperature'; known are resistance, "):
        load_study(path)
    path.write_text('terms = "dead_time"\n')
    with pytest.raises(InputError, match="terms must be a list, each item text, got 'dead_time'"):
        load_study(path)
    path.write_text('terms = ["resistance", "temperature_resistance"]\n')
    with pytest.raises(InputError, match="both describe the resistance"):
        load_study(path)


@pytest.mark.slow
def test_what_magnets_lose_a_kelvin_is_found_from_a_cold_and_a_hot_recording():
    runs = []
    for temperature in (20.0, 100.0):
        run = simulate(
            TRACTION_300A,
            Lissajous(200.0, rate_d=140.0, rate_q=150.0),
            speed_rpm=900.0,
            duration=0.2,
            drive=Drive(magnet_temperature=temperature),
        )
        warm = {"magnet_temperature": 0.0 * run.channels["i_d"] + temperature}
        runs.append(replace(run, name=f"{temperature:.0f}C", channels={**run.channels, **warm}))
    study = Study(horizon=1, terms=(MagnetTemperature(),), candidates=(), angle_orders=())
    fit = identify(runs, study=study)
    truth = TRACTION_300A.magnet_coefficient * TRACTION_300A.magnet_flux_linkage
    found = fit.parameters["magnet_coefficient"]
    assert abs(found.value / truth - 1) < 0.05
    assert found.unit == "Vs/K"
    assert "The map is that of the magnets at 20 degC" in temperatures_of(fit).of_map
