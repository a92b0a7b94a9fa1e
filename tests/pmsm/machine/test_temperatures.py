"""What is kept of recorded temperatures, and what a fit says of them."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.temperatures import (
    RECORDED,
    UNKNOWN,
    recorded_temperatures,
    temperatures_of,
)
from penode.pmsm.machine.terms import Channel, Resistance, Term
from penode.pmsm.report.no_current import of_winding


def recording(**channels):
    return Experiment("run.csv", 1e-3, {"i_d": np.zeros(4), **channels})


def test_mean_and_range_are_over_all_recordings():
    cold = recording(winding_temperature=np.array([20.0, 21.0, 22.0, 23.0]))
    hot = recording(winding_temperature=np.full(4, 80.0), magnet_temperature=np.full(4, 60.0))
    both = {"winding_temperature": [50.75, 20.0, 80.0], "magnet_temperature": []}
    assert recorded_temperatures([cold, hot]) == both
    assert recorded_temperatures([hot])["magnet_temperature"] == [60.0, 60.0, 60.0]


def test_a_winding_of_which_not_all_recordings_tell_has_no_temperature(machine_fit):
    partly = replace(machine_fit, provenance={RECORDED: {"winding_temperature": []}})
    known = temperatures_of(partly)
    assert (known.resistance, known.magnets) == (None, None)
    assert "not known; not all recordings have that of the winding." in known.of_resistance
    (row,) = of_winding(partly)
    assert (row.text, row.value) == ("not known", None)
    assert not of_winding(machine_fit)


def test_what_cannot_be_degrees_celsius_is_left_out():
    kelvin, gap = np.full(4, 353.0), np.array([20.0, np.nan, 21.0, 22.0])
    assert recorded_temperatures([recording(winding_temperature=kelvin)]) is None
    assert recorded_temperatures([recording(winding_temperature=gap)]) is None
    assert recorded_temperatures([recording()]) is None


class WarmMagnets(Term):
    role: ClassVar[str] = "magnet temperature"
    title: ClassVar[str] = "Magnets"
    channels: ClassVar[tuple[Channel, ...]] = (Channel("magnet_temperature", "degC", "magnets"),)

    def drop(self, x, u, flux):
        return 0.0 * x


def test_a_term_of_the_magnets_temperature_leaves_the_map_without_one(machine_fit):
    model = Machine(machine_fit.model.flux, (Resistance(0.01), WarmMagnets()))
    recorded = {"magnet_temperature": [60.0, 20.0, 100.0]}
    fit = replace(machine_fit, model=model, provenance={RECORDED: recorded})
    known = temperatures_of(fit)
    assert known.magnets is None
    assert "beside the term WarmMagnets of magnet_temperature" in known.of_map
    assert temperatures_of(machine_fit) == UNKNOWN
    assert known.without_resistance().sentences == known.of_map
