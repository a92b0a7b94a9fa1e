"""Fit: parameters in physical units with their uncertainty, the horizon's story, provenance."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from penode.arrays import BoolArray, FloatArray, float64
from penode.data.experiment import Experiment
from penode.data.rates import nearest
from penode.errors import InputError, require_extra
from penode.fit.archive import archive, read_archive, to_json
from penode.fit.learned_uncertainty import LearnedUncertainty
from penode.fit.model_tree import describe_module, restore_module
from penode.fit.outcome import Estimate, HorizonChoice, HorizonSummary
from penode.fit.result_folder import claimed, digests, replace_together, require_one_result
from penode.fit.summary import html, text
from penode.models.base import Model
from penode.predictors.base import Predictor
from penode.validation.comparison import Comparison, StationaryComparison, by_recording
from penode.validation.coverage import supported
from penode.validation.free_run import compare
from penode.validation.free_run_deviation import free_run_deviation
from penode.validation.residual_tests import Correlations, Spectrum

if TYPE_CHECKING:
    import polars as pl

    from penode.fit import plots

__all__ = ["Estimate", "Fit", "HorizonChoice", "HorizonSummary", "unused"]

SCHEMA = "penode/1"


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """What identification gives back.

    The learned maps of the model are methods of the fit: ``fit.flux_map(i_d, i_q)`` for a machine.
    Printed, it shows parameters, horizon and errors; a notebook shows them as a table.

    Attributes
    ----------
    model : Model
        The trained model; its leaves are physical values.
    parameters : mapping of str to Estimate
        Physical parameters.
    horizon : HorizonChoice
        Selected horizon, verdict and ladder.
    excited : ndarray, shape (sample, state)
        A thinned set of the states visited in training, SI units.
    comparisons : tuple of Comparison
        Measured against one-step and free-run predictions, per recording or stretch of one.
    spectrum : Spectrum
        Spectrum of the one-step residual on the first training recording, or its longest stretch.
    transitions : ndarray, shape (sample, past * state, past * state)
        One-step matrices of scaled errors along the recording of the spectrum
        (`penode.horizon.loss_weighting.linearised`); empty where the k-step error is more than a
        filtered one-step error.
    starts : ndarray, shape (state,)
        By how much the squares of a window grow with the square of a correction of its start, of
        scaled states; infinite where starts are as measured. Empty says so of all.
    learned_uncertainty : LearnedUncertainty
        What `learned_deviation` is computed from.
    covariance : ndarray, shape (parameter, parameter)
        Of the physical parameters in the order of `parameters`, SI units; the root of its diagonal
        is the deviation reported. What a parameter of unknown deviation shares with others is NaN.
    correlations : Correlations
        Of the one-step residual on the first training recording, with itself and with the inputs.
    nuisances : mapping of str to ndarray, shape (recording, ...)
        Parameters of which every training recording has its own value; the model has their mean.
    initial_states : mapping of str to mapping of str to Estimate
        Where the free run of each training recording starts, of the states whose start it
        estimates: those that are not measured, and all of a model with outputs.
    simulation : Model or None
        Of the same climb, the model whose free run on the recordings errs least; `model` itself
        where that of a plateau errs more by no more than chance.
    predictor : Predictor or None
        Shortest time step, solver and hold; None where the fit is of another method.
    stationary : StationaryComparison or None
        Of points at which nothing changes, beside what the model says of them.
    warnings : tuple of str
        One sentence each.
    provenance : mapping
        Versions, data hashes, seeds, command, wall time.
    """

    model: Model
    parameters: Mapping[str, Estimate]
    horizon: HorizonChoice
    excited: FloatArray
    comparisons: tuple[Comparison, ...] = ()
    spectrum: Spectrum = field(default_factory=Spectrum)
    transitions: FloatArray = field(default_factory=lambda: np.empty((0, 0, 0)))
    starts: FloatArray = field(default_factory=lambda: np.empty(0))
    learned_uncertainty: LearnedUncertainty = field(default_factory=LearnedUncertainty)
    covariance: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    correlations: Correlations = field(default_factory=Correlations)
    nuisances: Mapping[str, FloatArray] = field(default_factory=dict)
    initial_states: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    simulation: Model | None = None
    predictor: Predictor | None = None
    stationary: StationaryComparison | None = None
    warnings: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_") or name == "model":
            raise AttributeError(name)
        maps = self.model.maps()
        if name not in maps:
            raise AttributeError(f"Fit has no {name!r}; this model's maps are {sorted(maps)}.")
        return _in_float64(maps[name])

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.model.maps()]

    def __repr__(self) -> str:
        return text(self)

    def _repr_html_(self) -> str:
        return html(self)

    def parameters_frame(self) -> "pl.DataFrame":
        """Return a row a physical parameter: value, std, low_95, high_95 and unit, SI units."""
        return _frames().parameters_frame(self.parameters)

    def covariance_frame(self) -> "pl.DataFrame":
        """Return the covariance of the physical parameters by name, a row a parameter, SI units."""
        return _frames().matrix_frame(tuple(self.parameters), self.covariance)

    def correlation_frame(self) -> "pl.DataFrame":
        """Return the correlations of the physical parameters by name, a row a parameter."""
        return _frames().matrix_frame(tuple(self.parameters), self.correlation)

    def ladder_frame(self) -> "pl.DataFrame":
        """Return a row a horizon: parameters with NAME_std, errors, outcome, selected, plateau."""
        return _frames().ladder_frame(self.horizon)

    def plot_ladder(self) -> "plots.Figure":
        """Return a matplotlib figure of each physical parameter over the horizon, with 95 % bars.

        Raises
        ------
        InputError
            If the fit has no ladder or no physical parameter.
        """
        return _plots().draw_ladder(self)

    def plot_predictions(self, recording: int = 0) -> "plots.Figure":
        """Return a matplotlib figure of a recording and its predictions, errors below.

        Parameters
        ----------
        recording : int
            Index into `comparisons`.

        Raises
        ------
        InputError
            If there is no such recording.
        """
        if not -len(self.comparisons) <= recording < len(self.comparisons):
            raise InputError(
                f"recording must be < {len(self.comparisons)}, which are counted from 0, got "
                f"{recording}."
            )
        return _plots().draw_predictions(self.comparisons[recording])

    def plot_map(self, name: str = "", **ranges: tuple[float, float]) -> "plots.Figure":
        """Return a matplotlib figure of a learned map of one or two arguments.

        Parameters
        ----------
        name : str
            Of the map, such as ``"flux_map"``; without one, the model's first.
        **ranges : (float, float)
            Lowest and highest value of an argument; one called like a state has the excited range.

        Raises
        ------
        InputError
            If there is no such map, an argument has no range, or there are more than two.
        """
        return _plots().draw_map(self, name, ranges)

    def supported(self, points: FloatArray) -> BoolArray:
        """Return which points (point, state), SI units, lie in the excited region."""
        return supported(self.excited, np.asarray(points, dtype=np.float64))

    def learned_deviation(
        self, points: FloatArray, direction: FloatArray | None = None
    ) -> FloatArray:
        """Return the deviation of the learned map, shape (point, output), SI units.

        Parameters
        ----------
        points : ndarray, shape (point, state)
            SI units. Outside the excited region it shows what the map's form allows, no more.
        direction : ndarray, shape (state,), optional
            The deviation is that of the map's slope along it, such as an inductance's.
        """
        points = np.asarray(points, dtype=np.float64)
        return self.learned_uncertainty.deviation(self.model, points, direction)

    def compare(self, experiment: Experiment) -> Comparison:
        """Return a recording beside its predictions, with the solver and hold of the training.

        Raises
        ------
        InputError
            If a channel is missing, or the time step is none of the training.
        """
        return compare(self._predicting(experiment), self.model, experiment)

    @staticmethod
    def compare_models(fits: Mapping[str, "Fit"]) -> "pl.DataFrame":
        """Return fits of several models to the same recordings side by side, a row a model.

        Columns model; parameters, all numbers that were found from the training recordings, starts
        included; verdict, horizon; errors (rms) as ROLE_free_run_QUANTITY and
        ROLE_one_step_QUANTITY, of train and validation, null where there is none; effective_number,
        bic, bic_above_least. The criterion of Schwarz (Ann. Stat. 6 (1978) 461,
        doi:10.1214/aos/1176344136), sum_q N_q ln(rms_q^2) + parameters ln(sum_q N_q), is of the
        free run on the training recordings. N_q are the effective numbers of independent residuals
        (Bayley and Hammersley, J. R. Stat. Soc. Suppl. 8 (1946) 184, doi:10.2307/2983560) of the
        model that errs least.

        Parameters
        ----------
        fits : mapping of str to Fit
            By the name to be shown.

        Raises
        ------
        InputError
            If there is no fit, or the recordings or quantities differ.
        """
        require_extra("polars", "tables", "a table")
        from penode.fit.model_comparison import compare_models

        return compare_models(fits)

    def free_run_deviation(self, experiment: Experiment) -> FloatArray:
        """Return the standard deviation of a recording's free run, (time, quantity), SI units.

        By linearisation in all parameters, with the joint covariance of which `covariance` is the
        part of the physical ones, and in the initial states that the run estimates. Infinite where
        that is not known. The noise of the sensors is not part of it.

        Parameters
        ----------
        experiment : Experiment
            Has the channels that `compare` needs. What every recording has a value of its own of
            is at the mean over those trained on.

        Raises
        ------
        InputError
            If a channel is missing, or the time step is none of the training.
        """
        predictor = self._predicting(experiment)
        joint = self.learned_uncertainty.joint(self.model, self.covariance)
        return free_run_deviation(predictor, self.model, experiment, joint)

    def _predicting(self, experiment: Experiment) -> Predictor:
        """Return the predictor of the time step that was trained on and is nearest."""
        if self.predictor is None:
            raise InputError("the fit must have a predictor, got none; run the identification.")
        steps = [one.time_step for one in self.comparisons if one.role == "train"]
        return self.predictor.at(nearest([self.predictor.time_step, *steps], experiment))

    @property
    def correlation(self) -> FloatArray:
        """Correlations of the physical parameters, (parameter, parameter); NaN: not known."""
        deviation = np.sqrt(np.diag(self.covariance))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.covariance / np.outer(deviation, deviation))

    @property
    def recordings(self) -> tuple[Comparison, ...]:
        """The comparisons, the stretches of a recording as one."""
        return by_recording(self.comparisons)

    def result(self) -> dict[str, Any]:
        """Return the content of ``result.json``."""
        metrics: dict[str, Any] = {"train": {}, "validation": {}}
        for comparison in self.recordings:
            of_role = metrics[comparison.role]
            name = comparison.recording or comparison.name
            of_role[unused(name, of_role)] = comparison.metrics()
        if self.stationary is not None:
            metrics["stationary"] = {self.stationary.name: self.stationary.metrics()}
        starts = {
            recording: {name: asdict(one) for name, one in states.items()}
            for recording, states in self.initial_states.items()
        }
        return {
            "schema": SCHEMA,
            "horizon": asdict(self.horizon),
            "parameters": {name: asdict(p) for name, p in self.parameters.items()},
            **self._covariances(),
            **({"initial_states": starts} if starts else {}),
            "metrics": metrics,
            "warnings": list(self.warnings),
            "provenance": dict(self.provenance),
        }

    def _covariances(self) -> dict[str, dict[str, dict[str, float]]]:
        """Return the covariance by the names of both parameters, where there are two or more."""
        if len(self.covariance) < 2:
            return {}
        rows = zip(self.parameters, self.covariance.tolist(), strict=True)
        named = {name: dict(zip(self.parameters, row, strict=True)) for name, row in rows}
        return {"covariance": named}

    def save(self, folder: str | Path) -> None:
        """Write ``result.json`` and the reloadable ``fit/`` into a folder.

        Parameters
        ----------
        folder : str or Path
            Made if absent; files of an earlier fit are replaced together.

        Raises
        ------
        InputError
            If another process writes there.
        """
        with claimed(Path(folder)):
            replace_together(Path(folder), self.files())

    def files(
        self,
        beside: Mapping[str, bytes] = MappingProxyType({}),
        entries: Mapping[str, Any] = MappingProxyType({}),
    ) -> dict[str, bytes]:
        """Return what `save` writes: names in the folder to contents.

        Parameters
        ----------
        beside : mapping of str to bytes
            Other files of the same result; ``result.json`` has the digests of all.
        entries : mapping
            Further entries of ``result.json``.
        """
        arrays: dict[str, FloatArray] = {}
        parts = {
            f.name: describe_module(getattr(self, f.name), f.name, arrays) for f in fields(self)
        }
        archived = archive({"schema": SCHEMA, **parts}, arrays)
        made = {**beside, **{f"fit/{name}": content for name, content in archived.items()}}
        result = to_json({**self.result(), **entries, "files": digests(made)})
        return {**made, "result.json": result.encode()}

    @classmethod
    def load(cls, folder: str | Path, trust: bool = False) -> "Fit":
        """Read a fit back from the folder that `save` wrote.

        Parameters
        ----------
        folder : str or Path
        trust : bool
            Whether modules other than penode's are imported for the classes of the fit, which runs
            them. Without it their classes are taken where the program has imported them already.

        Raises
        ------
        InputError
            If a file is missing, damaged, of another schema or of another result than the rest,
            or the model's class is not trusted or cannot be imported.
        """
        require_one_result(Path(folder))
        document, arrays = read_archive(Path(folder) / "fit")
        schema = document.get("schema")
        if schema != SCHEMA:
            raise InputError(
                f"{folder}: the schema must be {SCHEMA!r}, got {schema!r}; read it with the "
                "version of penode that wrote it."
            )
        try:
            parts = {f.name: restore_module(document[f.name], arrays, trust) for f in fields(cls)}
            _require_usable(parts, arrays)
            return cls(**parts)
        except InputError as error:
            raise InputError(f"{folder}: {error}") from error
        except (LookupError, TypeError, AttributeError, ValueError, RecursionError) as error:
            raise InputError(
                f"{folder}: the saved fit lacks a part ({error!r}); run the identification again."
            ) from error


def _require_usable(parts: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> None:
    """Refuse what no training leaves, by TypeError and ValueError."""
    if not isinstance(parts["model"], Model) or not isinstance(parts["horizon"], HorizonChoice):
        raise TypeError("its model or its horizon is of another kind")
    excited = parts["excited"]
    if excited.ndim != 2 or not excited.size:
        raise ValueError(f"excited has the shape {excited.shape}")
    for name, values in arrays.items():
        if name.startswith(("model.", "comparisons.")) and not values.size:
            raise ValueError(f"{name} is empty")
        of_model = name == "excited" or name.startswith("model.")
        if of_model and not (values.dtype.kind in "fiub" and np.isfinite(values).all()):
            raise ValueError(f"{name} is not finite")


def _frames() -> Any:
    """Return the module of tables; it loads the library of data frames."""
    require_extra("polars", "tables", "a table")
    from penode.fit import frames

    return frames


def _plots() -> Any:
    """Return the module that draws; it loads the plotting library."""
    require_extra("matplotlib", "plot", "a figure")
    from penode.fit import plots

    return plots


def _in_float64(learned: Callable[..., Any]) -> Callable[..., Any]:
    """Return a learned map that computes in float64 and gives NumPy arrays back."""

    def evaluate(*arguments: Any, **named: Any) -> Any:
        with float64():
            return jax.tree.map(np.asarray, learned(*arguments, **named))

    return evaluate


def unused(name: str, taken: Mapping[str, Any]) -> str:
    """Return the name, numbered if the mapping has it already: files of several folders."""
    number, candidate = 2, name
    while candidate in taken:
        number, candidate = number + 1, f"{name} ({number})"
    return candidate
