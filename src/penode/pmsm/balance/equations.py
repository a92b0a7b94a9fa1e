"""The voltage balance of a recording in weak form, derived from the terms' own drops.

The voltage equation is not written down here: columns are the slopes of `Term.drop`.
"""

from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, in_blocks
from penode.data.experiment import Experiment
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.flux_maps import Flux
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.term_registry import channels_of, physical_places
from penode.pmsm.machine.terms import Term
from penode.training.weak_form import HannWindow, WeakRegression


def balance_equations(
    experiment: Experiment,
    terms: Sequence[Term],
    basis: FloatArray,
    length: int,
    further: Sequence[tuple[FloatArray, FloatArray]] = (),
) -> WeakRegression:
    """Return the weak form of d psi/dt = u - sum of drops, linear in what is unknown.

    Columns: `further` coefficients, by stored and supplied quantity (time, 2) each, the
    prepared terms' physical parameters in their order, the map, by the flux linkages `basis`
    (time, 2, coefficient). Windows hold `length` samples.
    """
    known_drop, by_parameter, by_psi = term_columns(experiment, terms)
    window = HannWindow(experiment.time_step, length)
    of_map = window.of_transformed(np.ascontiguousarray(basis), -by_psi)
    parts = [window.of_store(s) + window.of_supply(r) for s, r in further]
    matrix = np.concatenate(
        [*(part[..., None] for part in parts), -window.of_supply(by_parameter), of_map], axis=2
    )
    target = window.of_supply(known_drop) - window.of_held(experiment.stack(VOLTAGES))
    return WeakRegression(matrix.reshape(-1, matrix.shape[2]), target.ravel())


def term_columns(
    experiment: Experiment, terms: Sequence[Term]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the drops of terms at every sample, linearised in what is unknown.

    The known drop (time, 2), V, with all parameters and psi at zero, and its derivatives by
    each physical parameter (time, 2, parameter) and by psi (time, 2, 2), V/Vs; for the half
    samples before and after, linearised where the parameters stand, without flux linkage.
    """
    each = [_columns(experiment, term) for term in terms]
    known_drop = sum((known for known, _, _ in each), np.zeros((len(experiment), 2)))
    by_psi = sum((slope for _, _, slope in each), np.zeros((len(experiment), 2, 2)))
    by_parameter = [slope for _, slope, _ in each]
    return known_drop, np.concatenate(by_parameter, axis=2), by_psi


def _columns(experiment: Experiment, term: Term) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the `term_columns` of one term, whose program serves it beside any others."""
    names = (*VOLTAGES, *channels_of((term,)))
    rows = [experiment.stack(channels).T for channels in (CURRENTS, names)]
    with float64():
        blocks = [
            [np.asarray(part) for part in _linearised(term, x, u, names, experiment.time_step)]
            for x, u in zip(*map(in_blocks, rows), strict=True)
        ]
    known_drop, by_parameter, by_psi = (
        np.concatenate([np.ascontiguousarray(np.moveaxis(part, -1, 0)) for part in parts])
        for parts in zip(*blocks, strict=True)
    )
    count = len(experiment)
    return known_drop[:count], by_parameter[:count], by_psi[:count]


@partial(jax.jit, static_argnums=(3, 4))
def _linearised(
    term: Term, x: JaxArray, u: JaxArray, names: tuple[str, ...], step: float
) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Return the drop without flux linkage, and its slopes by parameters and by psi, time last."""
    (term,), no_flux = with_batch_axis((term,)), jnp.zeros_like(x)
    inputs = Inputs(u, names, (-0.5 * step, 0.5 * step))
    fields = [name for _, name in physical_places((term,))]

    def physical(term: Term) -> list[JaxArray]:
        return [getattr(term, name) for name in fields]

    def drop(values: JaxArray, psi: JaxArray) -> JaxArray:
        moved = eqx.tree_at(physical, term, list(values[:, None])) if fields else term
        return no_flux + moved.drop(x, inputs, Flux(psi, jnp.zeros((2, 2, 1)), no_flux))

    values = jnp.concatenate([jnp.zeros(0), *physical(term)])
    at_rest, pushed = jax.linearize(drop, values, no_flux)
    by_parameter = jax.vmap(pushed, (0, None), 1)(jnp.eye(len(values)), no_flux)
    units = jnp.eye(2)[:, :, None] + no_flux
    by_psi = jax.vmap(pushed, (None, 0), 1)(jnp.zeros_like(values), units)
    known_drop = at_rest - jnp.sum(by_parameter * values[:, None], axis=1)
    return known_drop, by_parameter, by_psi
