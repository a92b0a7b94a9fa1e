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
from functools import partial

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.horizon.identifiability import THRESHOLD
from penode.paper.conventional.linear_maps import LinearMap, polynomial
from penode.paper.conventional.linear_methods import LinearFit, LinearMethod, largest_current

#: Means over successive electrical periods that differ by less, in the largest current, stand.
_STILL = 0.005
#: Electrical periods at a point, the settling one included, below which it is passed, not held.
_LEAST_PERIODS = 3
#: Points this close, in the largest current, are one point.
_SAME = 0.02
#: Bounds of a period in samples, for speeds too high or too low to count by.
_SHORTEST, _LONGEST = 10, 2000


@dataclass(frozen=True)
class StationaryAveraging(LinearMethod):
    """Averages at operating points, and a smooth map through them."""

    basis: LinearMap = field(default_factory=partial(polynomial, 5, reciprocal=True))

    def solved(self, runs: Sequence[Experiment]) -> LinearFit:
        """Return resistance and map; see `LinearMethod`."""
        scale = largest_current(runs)
        points = [point for e in runs for point in operating_points(e)]
        groups = [_Group.of(together) for together in _fold(points, scale)]
        if not points:
            raise InputError(
                f"{runs[0].name}: the currents stand still nowhere for three electrical periods; "
                "record operating points that are held, or use a method for transients."
            )
        unknowns = self.basis.coefficients
        if 4 * len(groups) < unknowns:
            raise InputError(
                f"{runs[0].name}: {len(groups)} operating points cannot give a map of {unknowns} "
                "coefficients; hold more points, or use a smaller basis."
            )
        resistance, deviation, share = _resistance(runs[0], groups)
        return LinearFit(
            method="stationary averaging",
            network=self.basis.weighted(self._coefficients(groups, resistance, scale)),
            current_scale=scale,
            resistance=resistance,
            deviation=deviation,
            identifiability=share,
            reason="Means at operating points predict nothing, so there is no horizon.",
            facts={"operating_points": len(points), "averaged_to": len(groups)},
        )

    def _coefficients(
        self, groups: Sequence["_Group"], resistance: float, scale: float
    ) -> FloatArray:
        """Return the map's coefficients in Vs, fitted to the groups' flux linkages."""
        at = np.array([group.at for group in groups])
        flux = np.array([group.flux(resistance) for group in groups])
        mirror = np.array([1.0, -1.0])
        at, flux = np.concatenate([at, at * mirror]), np.concatenate([flux, flux * mirror])
        columns = self.basis.columns(at / scale)
        matrix = columns.reshape(-1, columns.shape[2])
        return np.asarray(np.linalg.lstsq(matrix, flux.ravel(), rcond=1e-10)[0])


@dataclass(frozen=True)
class OperatingPoint:
    """Means over whole electrical periods at one point, `omega_el` in rad/s."""

    # i_d + j i_q, A, and u_d + j u_q, V, as the machine sees it on average.
    current: complex
    voltage: complex
    omega_el: float
    samples: int


def operating_points(experiment: Experiment) -> tuple[OperatingPoint, ...]:
    """Find where the currents stand still, and average there; empty where they never dwell.

    The mean over one electrical period is free of offsets of the sensors (order 1 in dq) and of
    slots and dead time (orders 6, 12, ...). The currents stand while such means, taken one
    period apart, agree within 0.5 % of the largest current; the first period of a stretch is
    left out, in which currents settle, and a quarter of one at its end.
    """
    drive = experiment.stack(("i_d", "i_q", "u_d", "u_q", "omega_el"))
    speed = float(np.median(np.abs(drive[:, 4])))
    turn = max(speed * experiment.time_step, 1e-12)
    period = int(np.clip(round(2 * np.pi / turn), _SHORTEST, _LONGEST))
    if len(drive) < _LEAST_PERIODS * period:
        return ()
    tolerance = _STILL * float(np.abs(drive[:, :2]).max())
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(drive[:, :2], axis=0)])
    means = (sums[period:] - sums[:-period]) / period
    gaps = np.abs(means[period:] - means[:-period]).max(axis=1)
    points = []
    for first, last in _runs(np.asarray(gaps <= tolerance)):
        # Means from `first` to `last` and those a period later stand, so that their samples do, but
        # for a few at the end that one mean hides: the voltage of a step begins with a spike.
        end = last + 2 * period - 1 - period // 4
        whole = (end - first - period) // period * period
        if whole >= (_LEAST_PERIODS - 1) * period:
            points.append(_averaged(drive[end - whole : end]))
    return tuple(points)


def _runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return first and one past the last index of every run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _averaged(rows: FloatArray) -> OperatingPoint:
    i_d, i_q, u_d, u_q, omega = rows.mean(axis=0)
    return OperatingPoint(complex(i_d, i_q), complex(u_d, u_q), float(omega), len(rows))


def _fold(points: Sequence[OperatingPoint], scale: float) -> list[list[OperatingPoint]]:
    """Return the points that belong together: at one current, or mirrored at the d axis.

    Points within 2 % of `scale`, the largest current, A, are one, and so are motor and generator,
    of opposite i_q.
    """

    def at(point: OperatingPoint) -> complex:
        return complex(point.current.real, abs(point.current.imag))

    groups: list[list[OperatingPoint]] = []
    for point in points:
        near = (group for group in groups if abs(at(point) - at(group[0])) <= _SAME * scale)
        group = next(near, None)
        if group is None:
            groups.append([point])
        else:
            group.append(point)
    return groups


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
    def of(cls, points: Sequence[OperatingPoint]) -> "_Group":
        """Return points as one; a point on the other side of the d axis counts mirrored."""
        first = points[0].current.imag
        sides = [-1.0 if p.current.imag * first < 0 else 1.0 for p in points]
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


def _resistance(run: Experiment, groups: Sequence["_Group"]) -> tuple[float, float, float]:
    """Return R and its deviation in ohm, and the share of its regressor that is its own."""
    own = [group.without_flux(group.current) for group in groups]
    left = [group.without_flux(group.voltage) for group in groups]
    weight = sum(float(part @ part) for part in own)
    share = weight / sum(float(group.current @ group.current) for group in groups)
    if share < THRESHOLD:
        raise InputError(
            f"{run.name}: R cannot be separated from the flux linkages, as no operating point "
            "has its mirror image or the other direction of rotation; record motor and "
            "generator points, or both directions."
        )
    parts = list(zip(own, left, strict=True))
    resistance = sum(float(part @ rest) for part, rest in parts) / weight
    # Each group's score in R; groups are independent of each other.
    scores = [float(part @ (rest - resistance * part)) for part, rest in parts]
    return resistance, float(np.linalg.norm(scores)) / weight, share
