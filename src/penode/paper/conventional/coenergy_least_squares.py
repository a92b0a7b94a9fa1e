"""Linear least squares of the voltage equation over short windows, with a polynomial coenergy.

With a flux map that is linear in its coefficients the voltage equation d psi/dt = u - R i - J omega
psi is linear in R and these. Multiplied by a Hann window and integrated by parts over two periods
of the sixth harmonic (`penode.training.weak_form`) it needs no derivative of a measurement, and
what slotting and dead time add to all orders that the window nulls leaves R and the map alone. The
coenergy makes the map reciprocal, which is what separates R from it at one speed. Nothing is
trained: this is what a trained map has to be better than.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from penode.data.experiment import Experiment
from penode.fit.fit import Estimate, Fit
from penode.horizon.ladder import Observer, ignore_events
from penode.paper.conventional.linear_fit import LinearFit, largest_current, solution_of, usable
from penode.paper.conventional.linear_maps import LinearMap, coenergy_polynomial
from penode.pmsm.balance.voltage_balance import balance_equations, harmonic_window
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.holds import check_hold
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.term_registry import completed, with_physical
from penode.pmsm.machine.terms import Term
from penode.pmsm.recording.channels import drive_recording, require_channels
from penode.pmsm.recording.imperfection import KnownDrive
from penode.training.weak_form import WeakRegression, join

_REASON = "Linear least squares over short windows predicts nothing, so there is no horizon."


@dataclass(frozen=True)
class CoenergyLeastSquares:
    """Least squares of the voltage equation over short windows."""

    degree: int = 8
    # Whether the coenergy is even in i_q: the machine is symmetric about its d axis.
    mirrored: bool = True
    # Whether the dead-time voltage is identified too; the recordings then need theta_el.
    inverter: bool = False
    # Frame in which the voltage is held: "dq" or "stationary".
    hold: str = "dq"

    def __post_init__(self) -> None:
        check_hold(self.hold)
        coenergy_polynomial(self.degree, self.mirrored)

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Return resistance and map; see `penode.paper.conventional.method.Method`."""
        runs, unseen = usable(experiments), [drive_recording(e) for e in validation]
        return self.solved(runs).to_fit(runs, unseen)

    def solved(self, runs: Sequence[Experiment]) -> LinearFit:
        """Return resistance and map before anything is predicted."""
        scale, basis = largest_current(runs), coenergy_polynomial(self.degree, self.mirrored)
        dead_time = (DeadTime().prepared(scale),) if self.inverter else ()
        require_channels(runs, dead_time)
        acting = [KnownDrive(hold=self.hold).acting(e) for e in runs]
        equations = join([coenergy_equations(e, basis, scale, dead_time) for e in acting])
        smaller = f"a coenergy of a smaller degree than {self.degree}"
        solution = solution_of(equations, runs[0].name, smaller)
        first = 1 + len(dead_time)
        return LinearFit(
            method="least squares of a polynomial coenergy",
            network=basis.weighted(solution[first:]),
            current_scale=scale,
            resistance=float(solution[0]),
            deviation=equations.deviation(0),
            identifiability=equations.independence(0),
            reason=_REASON,
            hold=self.hold,
            terms=with_physical(dead_time, solution[1:first]),
            beside=_dead_time(equations, float(solution[1])) if dead_time else {},
        )


def coenergy_equations(
    experiment: Experiment, basis: LinearMap, scale: float, terms: Sequence[Term] = ()
) -> WeakRegression:
    """Return the voltage equation over short windows, linear in R and the map's coefficients.

    u_d and u_q are the mean voltages of each sample in the rotor frame; one unit of the map's
    inputs is `scale`, A; `terms` are prepared. Two rows a window, d and q in Vs; columns R in
    ohm, the terms' parameters in SI units, then the coefficients in Vs.
    """
    columns = basis.columns(experiment.stack(CURRENTS) / scale)
    return balance_equations(experiment, completed(terms), columns, harmonic_window(experiment))


def _dead_time(equations: WeakRegression, value: float) -> dict[str, Estimate]:
    meaning = "dead-time voltage of a phase"
    deviation, share = equations.deviation(1), equations.independence(1)
    return {"dead_time_voltage": Estimate.of(value, deviation, "V", share, meaning)}
