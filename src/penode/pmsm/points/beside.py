"""Operating points beside recordings: what points say narrows what recordings have shown.

A fit of recordings is a Gaussian belief about R and the coefficients of the map; points are linear
in both. What only the points may be wrong by (the inverter along the current, the angle, when the
voltages act, friction) is open within its prior. The gains of the sensors are those of the
recordings: both were measured on one bench, and no number of points makes them surer.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import cast

import numpy as np

from penode.arrays import FloatArray, float64
from penode.data.experiment import Experiment
from penode.fit.fit import Estimate, Fit
from penode.fit.learned_uncertainty import LearnedUncertainty, map_slopes, physical_slopes
from penode.fit.outcome import Contribution, Objection
from penode.horizon.objections import with_objections
from penode.models.layout import Layout
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.term_registry import physical_values
from penode.pmsm.points.balance import PointsBalance
from penode.pmsm.points.identify import as_measured
from penode.pmsm.points.recorded_torque import SHARED, WINDOW, TorqueBalance
from penode.pmsm.recording.drive_mapping import TORQUE
from penode.pmsm.recording.imperfections import Accuracy
from penode.validation.comparison import StationaryComparison

#: Fewest means of a recorded torque.
_FEWEST = 8
#: Deviation of the points' angle, rad, which the map of the recordings shows; and that of what
#: nothing is believed of, SI units.
_ANGLE, _FLAT = np.deg2rad(3.0), 1e3
#: Square of currents in which the map moves least, in reaches of the map, points a side, and the
#: weight of that beside what it should move at recorded currents.
_SQUARE, _SIDE, _BEYOND = 1.5, 25, 3e-2
#: Distance of points from recordings over what both allow beyond which they contradict each other.
_APART = 2.0


def with_points(fit: Fit, balances: Sequence[PointsBalance]) -> Fit:
    """Return the fit of recordings with the map ``coenergy``, narrowed by operating points.

    `balances` are of the points, one a width of the inverter's knee. What the fit says of the
    recordings stays, and where it is supported: a gain that the points show is one of its channels
    too. Points beyond the currents of the recordings are left out, as all are where nothing can be
    narrowed; a warning says so.
    """
    machine, points = cast(Machine, fit.model), balances[0].points
    reach = machine.flux.current_scale
    inside = np.abs(points.stack(CURRENTS)).max(axis=1) <= reach
    within = (
        f"{points.name}: {inside.sum()} of {len(points)} operating points lie within the currents "
        f"of the recordings, {reach:.3g} A"
    )
    if not fit.horizon.answered or not np.isfinite(fit.covariance).all():
        alone = "the recordings alone have no answer with an interval"
        return _warned(fit, f"{points.name}: the operating points were left out: {alone}")
    if inside.sum() < 2:
        return _warned(fit, f"{within}; they were left out")
    used = replace(points, channels={n: v[inside] for n, v in points.channels.items()})
    found = _with_equations(fit, [replace(one, points=used) for one in balances])
    return found if inside.all() else _warned(found, f"{within}; the others were left out")


def with_recorded_torque(
    fit: Fit, recordings: Sequence[Experiment], pole_pairs: int | None, accuracy: Accuracy
) -> Fit:
    """Return the fit of recordings, its map narrowed by their torque where they have one.

    `recordings` are corrected; without pole pairs the torque is left out, and a warning says so.
    """
    measured = [e for e in recordings if np.any(e.channels.get(TORQUE, 0.0))]
    if not measured:
        return fit
    name = measured[0].place.recording
    if not fit.horizon.answered or not np.isfinite(fit.covariance).all():
        return fit
    if pole_pairs is None:
        return _warned(fit, f"{name}: the torque was left out: pole_pairs is missing; add it")
    balance = TorqueBalance(name, measured, pole_pairs, accuracy, cast(Machine, fit.model))
    if len(balance.target) < _FEWEST:
        least = f"{_FEWEST * WINDOW:g} s"
        return _warned(fit, f"{name}: the torque was left out: it lasts less than {least}")
    found = _with_equations(fit, [balance])
    if found.horizon.answered:
        return found
    # A torque may be one that the drive computes of what it takes for its map.
    said = found.horizon.objections[-1]
    return _warned(fit, f"{said.reason} It was left out. {said.repair.removesuffix('.')}")


def _with_equations(fit: Fit, equations: Sequence[PointsBalance | TorqueBalance]) -> Fit:
    """Return a fit with an answer narrowed by equations, the mean over those that may be right."""
    machine = cast(Machine, fit.model)
    updates = [_Update(fit, machine, one, more) for one in equations for more in one.noises]
    likely = np.array([one.evidence for one in updates])
    weight = np.exp(likely - likely.max())
    weight /= weight.sum()
    best = updates[int(weight.argmax())]
    raw = np.tensordot(weight, np.stack([one.raw for one in updates]), axes=1)
    apart = np.stack([one.raw - raw for one in updates])
    spread = (weight * apart.T) @ apart
    own = np.tensordot(weight, np.stack([one.covariance for one in updates]), axes=1)
    return _narrowed(fit, best, raw, own + spread, spread)


def _warned(fit: Fit, sentence: str) -> Fit:
    """Return a fit with one more warning."""
    return replace(fit, warnings=(*fit.warnings, f"{sentence}."))


@dataclass(frozen=True, eq=False)
class _Update:
    """A fit of recordings, narrowed by points with one knee of the inverter and one noise."""

    fit: Fit
    machine: Machine
    balance: PointsBalance | TorqueBalance
    more: float = 1.0

    @cached_property
    def layout(self) -> Layout[Machine]:
        """Of the machine."""
        return Layout(self.machine)

    @cached_property
    def before(self) -> FloatArray:
        """Raw parameters of the recordings' fit (parameter,)."""
        return self.layout.raw(self.machine)

    @cached_property
    def slopes(self) -> FloatArray:
        """Physical parameters by raw ones, (physical, parameter)."""
        return physical_slopes(self.machine)

    @cached_property
    def belief(self) -> FloatArray:
        """Covariance of the raw parameters that the recordings show, without the shared gains."""
        joint = self.fit.learned_uncertainty.joint(self.machine, self.fit.covariance)
        size = np.sqrt(np.maximum(np.diag(joint), 1e-300))
        own = (joint - self.moved @ self.moved.T) / np.outer(size, size)
        values, vectors = np.linalg.eigh(own)
        root = vectors * np.sqrt(np.maximum(values, 0.0)) * size[:, None]
        return np.asarray(root @ root.T)

    @cached_property
    def moved(self) -> FloatArray:
        """What a deviation of each shared gain moves the raw parameters by, (parameter, gain)."""
        return np.stack([np.zeros_like(self.before), *self.shared.values()], axis=1)[:, 1:]

    @cached_property
    def shared(self) -> dict[str, FloatArray]:
        """The same by the name of the gain, as what is to be taken off the channels."""
        shifts = self.fit.learned_uncertainty.shifts
        sources = {n: one.source for n, (one, _) in self.balance.imperfections.items()}
        return {n: -shifts[sources[n]] for n in SHARED if sources.get(n) in shifts}

    @cached_property
    def matrix(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What raw parameters, shared gains and all else of the points add to each equation.

        The last are scaled to deviations of 1.
        """
        balance = self.balance
        rows = balance.rows(partial(map_slopes, self.machine))
        names, count = balance.names, len(balance.names)
        terms = list(physical_values(balance.terms))
        of_model = rows[:, count:].copy()
        for k, name in enumerate(terms):
            if name in self.layout.physical:
                of_model += np.outer(rows[:, k], self.slopes[self.layout.physical.index(name)])
        own = [k for k, n in enumerate(names) if n not in (*self.layout.physical, *SHARED)]
        scale = balance.prior_deviations(_FLAT)[own]
        believed = {n: std for n, (_, std) in balance.imperfections.items()}
        widened = [_ANGLE / believed[names[k]] if names[k] == "angle" else 1.0 for k in own]
        shared = [names.index(name) for name in self.shared]
        return of_model, rows[:, shared], rows[:, own] * scale * widened

    @cached_property
    def noise(self) -> FloatArray:
        """Deviation of each equation's noise."""
        deviation = np.ones(len(self.balance.target))
        for rows, own in zip(self.balance.outputs, self.balance.noise, strict=True):
            deviation[rows] = self.more * own
        return deviation

    @cached_property
    def left(self) -> FloatArray:
        """What the recordings' fit leaves of each equation."""
        flux = self.machine.maps()["flux_map"]
        values = {name: self.fit.parameters[name].value for name in self.layout.physical}
        return self.balance.left(lambda at: np.asarray(flux(*at.T)).T, values)

    @cached_property
    def gain(self) -> tuple[FloatArray, FloatArray]:
        """The gain of the update (parameter, equation), and the covariance of what is left."""
        of_model, of_gains, own = self.matrix
        # The gains moved the recordings' estimate too.
        apart = of_gains - of_model @ self.moved
        by_map = self.belief @ of_model.T
        crossed = by_map - self.moved @ apart.T
        expected = of_model @ by_map + apart @ apart.T + own @ own.T + np.diag(self.noise**2)
        return np.asarray(np.linalg.solve(expected, crossed.T).T), expected

    @cached_property
    def raw(self) -> FloatArray:
        """Raw parameters (parameter,)."""
        return np.asarray(self.before + self.gain[0] @ self.left)

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the raw parameters."""
        gain, expected = self.gain
        before = self.belief + self.moved @ self.moved.T
        return np.asarray(before - gain @ expected @ gain.T)

    @property
    def evidence(self) -> float:
        """Log likelihood of the points, given the recordings."""
        volume = np.linalg.slogdet(self.gain[1])[1]
        return float(-0.5 * (len(self.left) * self.distance**2 + volume))

    @cached_property
    def distance(self) -> float:
        """How far the points are from the recordings, over what both allow; about 1."""
        squares = self.left @ np.linalg.solve(self.gain[1], self.left)
        return float(np.sqrt(squares / len(self.left)))

    def within_support(self, step: FloatArray) -> FloatArray:
        """Return a step of the raw parameters that moves the map least beyond recorded currents.

        There points say nothing, and a belief with a wide band could give an inductance below zero.
        """
        square = _SQUARE * self.machine.flux.current_scale * np.linspace(-1, 1, _SIDE)
        beyond = np.stack(np.meshgrid(square, square), axis=-1).reshape(-1, 2)
        at = np.concatenate([self.fit.excited, self.balance.at])
        learned = self.layout.members(("learned",))
        inside, outside = (
            map_slopes(self.machine, places).reshape(2 * len(places), -1) for places in (at, beyond)
        )
        mean = learned & (np.abs(outside).max(axis=0) > 0)
        stacked = np.concatenate([inside[:, mean], _BEYOND * outside[:, mean]])
        wanted = np.concatenate([inside[:, mean] @ step[mean], np.zeros(len(outside))])
        kept = step.copy()
        kept[mean] = np.linalg.lstsq(stacked, wanted, rcond=None)[0]
        return kept

    def budget(self, place: int, total: float, spread: float) -> tuple[Contribution, ...]:
        """Return the budget of a physical parameter of variance `total`, `spread` by the knees."""
        name, slope = self.layout.physical[place], self.slopes[place]
        before = self.fit.parameters[name].budget
        of_model, of_gains, own = self.matrix
        of_equations = slope @ self.gain[0]
        sources = {self.balance.imperfections[n][0].source: k for k, n in enumerate(self.shared)}
        by_gain = slope @ self.moved + of_equations @ (of_gains - of_model @ self.moved)
        of_points = np.sum((of_equations @ own) ** 2) + np.sum((of_equations * self.noise) ** 2)
        rest = max(total - spread - of_points - np.sum(by_gain**2), 0.0)
        others = sum(row.std**2 for row in before if row.source not in sources)
        part = np.sqrt(rest / others) if others else 0.0
        rows = [
            replace(row, std=abs(float(by_gain[sources[row.source]])))
            if row.source in sources
            else replace(row, std=float(part * row.std))
            for row in before
        ]
        rows.append(
            Contribution(
                self.balance.source,
                float(np.sqrt(of_points + spread)),
                remedy=self.balance.remedy,
            )
        )
        return tuple(sorted(rows, key=lambda row: -row.std))


def _narrowed(
    fit: Fit, best: _Update, raw: FloatArray, covariance: FloatArray, spread: FloatArray
) -> Fit:
    """Return the fit at raw parameters; `spread` is the part of their covariance by the knees."""
    layout, slopes = best.layout, best.slopes
    raw = best.before + best.within_support(raw - best.before)
    with float64():
        model: Machine = layout.plain_model(raw)
    values = slopes @ (raw - best.before)
    estimates = {}
    for k, name in enumerate(layout.physical):
        old, (total, knees) = (
            fit.parameters[name],
            (float(slopes[k] @ part @ slopes[k]) for part in (covariance, spread)),
        )
        rows, std = best.budget(k, total, knees), float(np.sqrt(total))
        shown = old.identifiability, old.meaning, rows
        estimates[name] = Estimate.of(old.value + float(values[k]), std, old.unit, *shown)
    about = f"{best.balance.about}; recordings are predicted without them."
    structure = [*fit.provenance.get("structure", ()), about]
    found = replace(
        fit,
        model=model,
        parameters=estimates,
        stationary=_compared(best),
        covariance=slopes @ covariance @ slopes.T,
        learned_uncertainty=LearnedUncertainty(covariance, raw[None], np.ones(1)),
        provenance={**fit.provenance, "structure": structure},
    )
    if best.distance <= _APART:
        return found
    objection = Objection(
        "points contradict",
        f"{best.balance.name}: {best.balance.subject} {best.distance:.1f} times as far from "
        "what the recordings say as the accuracy of both allows.",
        best.balance.contradiction,
    )
    return with_objections(found, [objection])


def _compared(one: _Update) -> StationaryComparison:
    """Return equations beside a model that knew none of them, each told by it and all others.

    Rasmussen and Williams, Gaussian Processes for Machine Learning, 5.4.2.
    """
    precision = np.linalg.inv(one.gain[1])
    spread = np.diag(precision) ** -0.5
    apart = precision @ one.left
    target = one.balance.target
    return as_measured(
        one.balance, target - one.noise**2 * apart, target - apart * spread**2, spread
    )
