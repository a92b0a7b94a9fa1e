"""What an inverter takes of the voltage by the sign of each phase current: dead time and devices.

While both switches of a leg are off, the phase current decides the voltage; a phase with much
current loses dU = u_dc t_dead / T over a sample, and the threshold of its devices beside, one near
its zero less. Jeong and Park, IEEE Trans. Ind. Electron. 38 (1991) 108, doi:10.1109/41.88903. What
the devices drop in proportion to the current cannot be distinguished from R.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar, Self, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray, Leaf
from penode.models.inputs import Inputs
from penode.models.parameters import parameter, physical
from penode.models.transforms import Positive
from penode.pmsm.machine.flux_maps import Flux
from penode.pmsm.machine.terms import ANGLE, SPEED, Channel, Term

#: Guess of i_0 over the largest current.
_GUESS = 0.01
#: Narrowest knee over the largest current, before it is rounded down. A sharper one cannot be told
#: from it: i_0 would go on towards zero, where single samples at a kink decide where a window
#: starts and what is best.
_SHARPEST = 0.003
#: Widest knee over the narrowest, a fifth to two fifths of the largest current. A wider one is a
#: straight line at every current: a resistance, and no dead time.
_WIDEST = 128.0
#: Half the width of the narrowest mean; the closed form divides by it.
_NARROW = 0.02
#: E-folds between the saturation current of a junction and the largest current, within a few.
FOLDS = 16.0


_Function: TypeAlias = Callable[[JaxArray], JaxArray]


def _area_of_tanh(x: JaxArray) -> JaxArray:
    """Return log(2 cosh x), the integral of tanh, without overflow."""
    size = jnp.abs(x)
    return size + jnp.log1p(jnp.exp(-2 * size))


def _area_of_arctan(x: JaxArray) -> JaxArray:
    return 2 / np.pi * (x * jnp.arctan(x) - 0.5 * jnp.log1p(x**2))


def _arctan(x: JaxArray) -> JaxArray:
    return 2 / np.pi * jnp.arctan(x)


def _node(x: JaxArray) -> JaxArray:
    size = jnp.abs(x)
    large = jnp.sign(x) * (1 - 0.5 / jnp.maximum(size, 1.0))
    return jnp.where(size < 1.0, 0.5 * x, large)


def _area_of_node(x: JaxArray) -> JaxArray:
    size = jnp.abs(x)
    large = jnp.maximum(size, 1.0)
    return jnp.where(size < 1.0, 0.25 * x**2, large - 0.5 * jnp.log(large) - 0.75)


#: A knee with a tail, and the integral of it, of the current over its width. ``"node"`` is of dead
#: time t alone: a leg's node of capacitance C at the voltage U is recharged by a current i in
#: C U / i. While that is shorter than t half of it is lost less, else half of i t / C is lost; both
#: are in units of U and t, and the width is C U / t.
TAILS: dict[str, tuple[_Function, _Function]] = {
    "arctan": (_arctan, _area_of_arctan),
    "node": (_node, _area_of_node),
}


def _area_of_arsinh(x: JaxArray) -> JaxArray:
    return x * jnp.arcsinh(x) - jnp.hypot(1.0, x)


def _mean(
    sign: _Function,
    area: _Function,
    middle: JaxArray,
    sweep: JaxArray | None,
) -> JaxArray:
    """Return a sign, or by its integral the mean of it over all within a sweep of the middle."""
    if sweep is None:
        return sign(middle)
    half = jnp.sqrt(sweep**2 + _NARROW**2)
    # One area of both ends: a sixth less to compile.
    end, begin = area(jnp.stack([middle + half, middle - half]))
    return (end - begin) / (2 * half)


class PhaseSigns(Term):
    """Smooth signs of the phase currents, which the dead-time terms multiply by voltages.

    A phase current crosses zero within a fraction of a sample. The four stages of the classic
    Runge-Kutta method would see its sign at three moments, by chance and not without a bias: at
    1500 rpm and 10 kHz it made R of a 16 mohm machine 0.4 % too small. So each stage takes the
    mean over its part of the sample (`Inputs.part_for`).
    """

    role: ClassVar[str] = "dead time"
    channels: ClassVar[tuple[Channel, ...]] = (SPEED, ANGLE)

    dead_time_current: eqx.AbstractVar[Leaf]
    dead_time_softness: eqx.AbstractVar[Leaf]
    dead_time_tail: eqx.AbstractVar[str]
    junction_voltage: eqx.AbstractVar[Leaf]
    junction_folds: eqx.AbstractVar[float]
    narrowest: eqx.AbstractVar[float]

    def lost(self, voltages: JaxArray, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the lost voltage in dq, of that at much current, (3 or 1, batch), V."""
        cosine, sine = jnp.cos(u[ANGLE.name]), jnp.sin(u[ANGLE.name])
        alpha = cosine * x[0] - sine * x[1]
        beta = sine * x[0] + cosine * x[1]
        width = self.dead_time_current
        if self.narrowest:
            bent = width / jnp.hypot(1.0, width / (_WIDEST * self.narrowest))
            width = jnp.hypot(bent, self.narrowest)
        phases, ahead = _phases(alpha, beta), _phases(-beta, alpha)
        middle, half = u.part_for("dead time")

        def swept(width: JaxArray) -> tuple[JaxArray, JaxArray | None]:
            at, rates = phases / width, u[SPEED.name] * (ahead / width)
            moment = isinstance(half, float) and half == 0.0
            return (at, None) if moment else (at + middle * rates, half * rates)

        signs = _mean(jnp.tanh, _area_of_tanh, *swept(width))
        if self.dead_time_softness is not None:
            soft = _mean(*TAILS[self.dead_time_tail], *swept(width))
            signs = signs + self.dead_time_softness * (soft - signs)
        taken = voltages * signs
        if self.junction_voltage is not None:
            largest = (self.narrowest or width) / _SHARPEST
            twice = jnp.asarray(2 * largest * math.exp(-self.junction_folds))
            law = _mean(jnp.arcsinh, _area_of_arsinh, *swept(twice))
            taken = taken + self.junction_voltage * law
        a, b, c = taken
        lost_alpha, lost_beta = (2 * a - b - c) / 3, (b - c) / np.sqrt(3)
        return jnp.stack(
            [cosine * lost_alpha + sine * lost_beta, cosine * lost_beta - sine * lost_alpha]
        )

    def prepared(self, largest_current: float) -> Self:
        """Return the term with its narrowest knee, and i_0 where it is not set.

        The narrowest is a power of two in A, so that one program serves many recordings.
        """
        narrowest = 2.0 ** math.floor(math.log2(_SHARPEST * max(largest_current, 1e-9)))
        width = self.dead_time_current
        guess = _GUESS * largest_current if width is None else width
        return replace(self, dead_time_current=guess, narrowest=narrowest)


class DeadTime(PhaseSigns):
    """dU knee(i / width) in every phase: what dead time and thresholds take.

    Attributes
    ----------
    dead_time_voltage : array, shape ()
        dU in V.
    dead_time_current : array, shape (), or None
        i_0 in A, the width of the knee between its limits; a hundredth of the largest recorded
        current where None. It moves in training but is not reported: a phase current crosses zero
        within a fraction of a sample, which says little of it.
    dead_time_softness : array, shape (), or None
        s of the knee (1 - s) tanh(i/i_0) + s tail(i/i_0): 1 has long tails. It moves in training,
        so that what is not known of it is in the interval of R. None is sharp, tanh.
    dead_time_tail : str
        ``"arctan"``, that is 2/pi arctan(x), or ``"node"``, of the capacitance of a leg's node: x/2
        up to x = 1, from there on 1 - 1/(2 x).
    junction_voltage : array, shape (), or None
        n k T/q in V, by which the drop of a device rises with each e-fold of the current beside
        that: the law n k T/q asinh(i/(2 i_s)) of a junction (Shockley, Bell Syst. Tech. J. 28
        (1949) 435, doi:10.1002/j.1538-7305.1949.tb03645.x). It moves in training. None for none.
    junction_folds : float
        Natural logarithm of the largest current over i_s.
    narrowest : float
        Width in A that adds to i_0 in squares; 128 times as wide a knee is the widest. 0 for no
        limits.
    """

    title: ClassVar[str] = "Dead time"

    dead_time_voltage: Leaf = physical("V", default=0.0, meaning="dead-time voltage of a phase")
    dead_time_current: Leaf = parameter(
        unit="A", group="physical", transform=Positive(), default=None
    )
    dead_time_softness: Leaf = parameter(group="physical", default=None)
    dead_time_tail: str = eqx.field(static=True, default="arctan")
    junction_voltage: Leaf = parameter(unit="V", group="physical", default=None)
    junction_folds: float = eqx.field(static=True, default=FOLDS)
    narrowest: float = eqx.field(static=True, default=0.0)

    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return dU times the smooth signs of the phase currents, in dq; see `Term.drop`."""
        return self.lost(jnp.atleast_1d(self.dead_time_voltage)[None], x, u)


class PhaseDeadTime(PhaseSigns):
    """dU_a, dU_b, dU_c knee(i/i_0): `DeadTime` whose phases differ.

    Attributes
    ----------
    dead_time_voltage_a, dead_time_voltage_b, dead_time_voltage_c : array, shape ()
        dU of each phase in V.
    dead_time_current, dead_time_softness, dead_time_tail
    junction_voltage, junction_folds, narrowest
        As in `DeadTime`, the same in every phase.
    """

    title: ClassVar[str] = "Dead time by phase"

    dead_time_voltage_a: Leaf = physical("V", default=0.0, meaning="dead-time voltage, phase a")
    dead_time_voltage_b: Leaf = physical("V", default=0.0, meaning="dead-time voltage, phase b")
    dead_time_voltage_c: Leaf = physical("V", default=0.0, meaning="dead-time voltage, phase c")
    dead_time_current: Leaf = parameter(
        unit="A", group="physical", transform=Positive(), default=None
    )
    dead_time_softness: Leaf = parameter(group="physical", default=None)
    dead_time_tail: str = eqx.field(static=True, default="arctan")
    junction_voltage: Leaf = parameter(unit="V", group="physical", default=None)
    junction_folds: float = eqx.field(static=True, default=FOLDS)
    narrowest: float = eqx.field(static=True, default=0.0)

    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return each phase's dU times its current's smooth sign, in dq; see `Term.drop`."""
        voltages = (self.dead_time_voltage_a, self.dead_time_voltage_b, self.dead_time_voltage_c)
        return self.lost(jnp.stack([jnp.atleast_1d(v) for v in voltages]), x, u)


class MeanDeadTime(Term):
    """dU i/abs(i): what dead time takes over a turn, where the rotor's angle is not known.

    The mean over the angle of a sharp dead time dU_phase in every phase is 4/pi dU_phase along the
    current. An inverter that corrects more than its dead time has a negative one.

    Attributes
    ----------
    inverter_voltage : array, shape ()
        dU in V.
    knee_current : float or None
        Current in A below which it bends to zero; a hundredth of the largest where None.
    """

    role: ClassVar[str] = "dead time"
    title: ClassVar[str] = "The inverter's voltage along the current"

    inverter_voltage: Leaf = physical(
        "V", default=0.0, meaning="inverter voltage, 4/pi of that of dead time"
    )
    knee_current: float | None = eqx.field(static=True, default=None)

    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return dU along the current in V; see `Term.drop`."""
        knee = self.knee_current or 1e-9
        return self.inverter_voltage * x / jnp.sqrt(jnp.sum(x**2, axis=0) + knee**2)

    def prepared(self, largest_current: float) -> Self:
        """Return the term with its knee in A, a power of two: one program serves many drives."""
        guess = 2.0 ** math.floor(math.log2(_GUESS * max(largest_current, 1e-9)))
        return replace(self, knee_current=self.knee_current or guess)


def _phases(alpha: JaxArray, beta: JaxArray) -> JaxArray:
    """Return the three phase values (3, batch) of a stationary vector."""
    half, root = 0.5 * alpha, np.sqrt(0.75) * beta
    return jnp.stack([alpha, root - half, -root - half])
