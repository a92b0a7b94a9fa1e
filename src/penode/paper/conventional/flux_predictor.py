"""Joint linear least squares of resistance and map: the one-step flux predictor.

With psi = psi_d + j psi_q, the voltage equation d psi/dt = u - R i - j omega psi gives over one
sample, exactly, with z = -j omega T,

    psi(i_(k+1)) = exp(z) psi(i_k) + int_0^T exp(z (1 - s/T)) (u - R i) ds.

For currents that are straight between samples and a map that is linear in its coefficients this is
one linear equation a sample in R and the coefficients. Its least-squares solution is the flux
predictor of Ortombina et al. 2020 and Montecchio 2025 (paper, section 4.2): NARX training, H = 1,
in the flux linkages instead of the currents.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from penode.arrays import ComplexArray, FloatArray
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.horizon.ladder import Observer, ignore_events
from penode.paper.conventional.linear_fit import LinearFit, largest_current, solution_of, usable
from penode.paper.conventional.linear_maps import LinearMap, polynomial
from penode.paper.conventional.rotation import held, rising
from penode.pmsm.machine.holds import check_hold
from penode.pmsm.recording.channels import drive_recording
from penode.training.weak_form import WeakRegression, join

_REASON = "Linear least squares of the flux one step ahead has no horizon but 1."


@dataclass(frozen=True)
class FluxPredictor:
    """Least squares of the flux linkage one step ahead."""

    basis: LinearMap = field(default_factory=polynomial)
    # Frame in which the voltage is held: "dq" or "stationary".
    hold: str = "dq"

    def __post_init__(self) -> None:
        check_hold(self.hold)

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Return resistance and map; see `penode.paper.conventional.method.Method`."""
        runs, unseen = usable(experiments), [drive_recording(e) for e in validation]
        scale = largest_current(runs)
        equations = join([flux_equations(e, self.basis, scale, self.hold) for e in runs])
        smaller = f"a smaller basis than this {self.basis.name}"
        solution = solution_of(equations, runs[0].name, smaller)
        return LinearFit(
            method=f"flux predictor, {self.basis.name}",
            network=self.basis.weighted(solution[1:]),
            current_scale=scale,
            resistance=float(solution[0]),
            deviation=equations.deviation(0),
            identifiability=equations.independence(0),
            reason=_REASON,
            hold=self.hold,
        ).to_fit(runs, unseen)


def flux_equations(
    experiment: Experiment, basis: LinearMap, scale: float, hold: str = "dq"
) -> WeakRegression:
    """Return the balance of each sample, linear in R and the map's coefficients.

    One unit of the map's inputs is `scale`, A. Two rows a sample, d and q in Vs; columns R in
    ohm, then the coefficients in Vs.
    """
    currents = experiment.stack(("i_d", "i_q"))
    drive = experiment.stack(("u_d", "u_q", "omega_el"))[:-1]
    turn = np.asarray(-1j * experiment.time_step * drive[:, 2], dtype=np.complex128)
    voltage, current = drive[:, 0] + 1j * drive[:, 1], currents[:, 0] + 1j * currents[:, 1]
    within = held(turn)
    columns = basis.columns(currents / scale)
    psi = columns[:, 0] + 1j * columns[:, 1]
    rise = psi[1:] - np.exp(turn)[:, None] * psi[:-1]
    drop = experiment.time_step * (within * current[:-1] + rising(turn) * np.diff(current))
    acting = np.exp(turn) if hold == "stationary" else within
    supply = np.asarray(experiment.time_step * voltage * acting, dtype=np.complex128)
    matrix: ComplexArray = np.concatenate([drop[:, None], rise], axis=1).astype(np.complex128)
    return WeakRegression(_parts(matrix).reshape(-1, matrix.shape[1]), _parts(supply).ravel())


def _parts(values: ComplexArray) -> FloatArray:
    """Return d and q of complex rows (time, ...) as (time, 2, ...)."""
    return np.stack([values.real, values.imag], axis=1)
