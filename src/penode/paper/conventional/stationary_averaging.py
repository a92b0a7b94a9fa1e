"""Stationary averaging: flux linkages at operating points, motor and generator averaged.

At rest the voltage equation is u = R i + j omega psi. The machine is symmetric about its d axis,
so that a motor point (i_d, i_q) and a generator point (i_d, -i_q) share psi_d and differ in the
sign of psi_q; and points at both directions of rotation share both. Of such points

    u_d = R i_d - omega s psi_q,    u_q = R i_q + omega psi_d,    s = sign of i_q,

is linear in R and the point's two flux linkages: for one motor and one generator point at one speed
psi_d is the mean of both u_q over omega and psi_q half the difference of both u_d, whatever R is
(Armando, Bojoi, Guglielmi, Pellegrino and Pastorelli, IEEE Trans. Ind. Appl. 49 (2013),
doi:10.1109/TIA.2013.2258876).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.identifiability import THRESHOLD
from penode.horizon.ladder import Observer, ignore_events
from penode.paper.conventional.linear_fit import LinearFit, largest_current, usable
from penode.paper.conventional.linear_maps import LinearMap, polynomial
from penode.paper.conventional.operating_points import (
    OperatingPoint,
    fold,
    operating_points,
)
from penode.pmsm.machine.holds import check_hold
from penode.pmsm.recording.channels import drive_recording

_REASON = "Means at operating points predict nothing, so there is no horizon."


def _smooth_map() -> LinearMap:
    return polynomial(5, reciprocal=True)


@dataclass(frozen=True)
class StationaryAveraging:
    """Averages at operating points, and a smooth map through them."""

    # ohm; None finds it from motor against generator points, or both directions of rotation.
    resistance: float | None = None
    basis: LinearMap = field(default_factory=_smooth_map)
    # Whether motor and generator points stand for one another, by symmetry about the d axis.
    mirrored: bool = True
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
        points = [point for e in runs for point in operating_points(e, self.hold)]
        together = fold(points, scale, self.mirrored)
        groups = [_Group.of([points[k] for k in g], self.mirrored) for g in together]
        self._require(runs[0], points, groups)
        resistance, deviation, share = self._resistance(runs[0], groups)
        return LinearFit(
            method="stationary averaging",
            network=self.basis.weighted(self._coefficients(groups, resistance, scale)),
            current_scale=scale,
            resistance=resistance,
            deviation=deviation,
            identifiability=share,
            reason=_REASON,
            hold=self.hold,
            facts={"operating_points": len(points), "averaged_to": len(groups)},
        ).to_fit(runs, unseen)

    def _require(
        self, run: Experiment, points: Sequence[OperatingPoint], groups: Sequence["_Group"]
    ) -> None:
        if not points:
            raise InputError(
                f"{run.name}: the currents stand still nowhere for three electrical periods; "
                "record operating points that are held, or use a method for transients."
            )
        equations = 2 * len(groups) * (2 if self.mirrored else 1)
        unknowns = self.basis.coefficients
        if equations < unknowns:
            raise InputError(
                f"{run.name}: {len(groups)} operating points came for a map of {unknowns} "
                "coefficients; hold more points, or use a smaller basis."
            )

    def _resistance(
        self, run: Experiment, groups: Sequence["_Group"]
    ) -> tuple[float, float, float | None]:
        """Return R and its deviation in ohm, and the share of its regressor that is its own."""
        if self.resistance is not None:
            return self.resistance, 0.0, None
        own = [group.without_flux(group.current) for group in groups]
        left = [group.without_flux(group.voltage) for group in groups]
        weight = sum(float(part @ part) for part in own)
        share = weight / sum(float(group.current @ group.current) for group in groups)
        if share < THRESHOLD:
            raise InputError(
                f"{run.name}: R cannot be separated from the flux linkages, as no operating point "
                "has its mirror image or the other direction of rotation; record motor and "
                "generator points, or both directions, or give the resistance."
            )
        parts = list(zip(own, left, strict=True))
        resistance = sum(float(part @ rest) for part, rest in parts) / weight
        # Each group's score in R; groups are independent of each other.
        scores = [float(part @ (rest - resistance * part)) for part, rest in parts]
        return resistance, float(np.linalg.norm(scores)) / weight, share

    def _coefficients(
        self, groups: Sequence["_Group"], resistance: float, scale: float
    ) -> FloatArray:
        """Return the map's coefficients in Vs, fitted to the groups' flux linkages."""
        at = np.array([group.at for group in groups])
        flux = np.array([group.flux(resistance) for group in groups])
        if self.mirrored:
            mirror = np.array([1.0, -1.0])
            at, flux = np.concatenate([at, at * mirror]), np.concatenate([flux, flux * mirror])
        columns = self.basis.columns(at / scale)
        matrix = columns.reshape(-1, columns.shape[2])
        return np.asarray(np.linalg.lstsq(matrix, flux.ravel(), rcond=1e-10)[0])


@dataclass(frozen=True, eq=False)
class _Group:
    """Points that share psi_d and, but for its sign, psi_q; two rows a point, d then q."""

    # Mean i_d and i_q (2,), A, on the first point's side of the d axis.
    at: FloatArray
    # (2 point,), A, and the voltage in V.
    current: FloatArray
    voltage: FloatArray
    # What psi_d and psi_q on the first point's side induce (2 point, 2), rad/s.
    turning: FloatArray

    @classmethod
    def of(cls, points: Sequence[OperatingPoint], mirrored: bool) -> "_Group":
        """Return points as one; a point on the other side of the d axis counts mirrored."""
        first = points[0].current.imag
        sides = [-1.0 if mirrored and p.current.imag * first < 0 else 1.0 for p in points]
        signed = list(zip(points, sides, strict=True))
        at = np.mean([[p.current.real, side * p.current.imag] for p, side in signed], axis=0)
        current = np.array([[p.current.real, p.current.imag] for p in points])
        voltage = np.array([[p.voltage.real, p.voltage.imag] for p in points])
        rows = [[[0.0, -side * p.omega_el], [p.omega_el, 0.0]] for p, side in signed]
        return cls(at, current.ravel(), voltage.ravel(), np.concatenate(rows))

    def without_flux(self, rows: FloatArray) -> FloatArray:
        """Return what the flux linkages cannot explain of rows (2 point,)."""
        coefficients = np.linalg.lstsq(self.turning, rows, rcond=None)[0]
        return np.asarray(rows - self.turning @ coefficients)

    def flux(self, resistance: float) -> FloatArray:
        """Return psi_d and psi_q, shape (2,), in Vs on the first point's side of the d axis."""
        left = self.voltage - resistance * self.current
        return np.asarray(np.linalg.lstsq(self.turning, left, rcond=None)[0])
