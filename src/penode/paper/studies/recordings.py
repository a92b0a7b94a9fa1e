"""Recordings of the studies: the shipped configurations, and others of the same drives."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from penode.bench.config import Simulation, load_config
from penode.bench.references import (
    GENERATOR,
    MOTOR,
    Lissajous,
    Reference,
    Spiral,
    stationary_grid,
)
from penode.bench.run import Recording
from penode.bench.shaft import Speed, SpeedRipple
from penode.bench.truth import plain
from penode.data.experiment import Experiment
from penode.paper.studies.variants import Extent

#: Speed ripple of the bench: mechanical order, share of the speed, rad.
_RIPPLE = ((1.0, 0.002, 0.0), (2.0, 0.001, 0.7))
#: Time at each operating point in s.
_DWELL = 0.05


@dataclass(frozen=True, eq=False)
class Case:
    """One recording to learn from, with its truth, and others of the same drive to predict.

    ``name`` is a key of `CASES`, ``label`` what figures call it; unseen are other speeds, currents
    and trajectories.
    """

    name: str
    label: str
    recording: Recording
    unseen: tuple[Recording, ...]

    @property
    def experiment(self) -> Experiment:
        """What is learned from."""
        return replace(self.recording.experiment, name=self.name)

    @property
    def validation(self) -> tuple[Experiment, ...]:
        """What is predicted only."""
        return tuple(
            replace(run.experiment, name=f"{k + 1}: {run.experiment.name}")
            for k, run in enumerate(self.unseen)
        )


def _well_designed_testbench() -> Simulation:
    """Return the well-designed experiment with every imperfection of the bench."""
    good, bench = load_config("well_designed"), load_config("paper_testbench")
    speed = SpeedRipple(150.0, _RIPPLE)
    return replace(good, drive=bench.drive, speed_rpm=speed, seed=bench.seed)


def _motor_operation() -> Simulation:
    """Return the simulated system in motor operation alone: i_d below, i_q above zero."""
    whole = load_config("paper_simulation")
    return replace(whole, reference=Lissajous(240.0, 14.0, 15.0, MOTOR))


def _operating_points() -> Simulation:
    """Return the simulated system at operating points that are held, motor and generator."""
    grid = stationary_grid(240.0, points=7, dwell=_DWELL)
    return replace(load_config("paper_simulation"), reference=grid, duration=grid.duration)


#: Name of a recording to how figures call it and how it is made.
CASES: dict[str, tuple[str, Callable[[], Simulation]]] = {
    # The paper's simulated system and its test bench, with every imperfection on.
    "simulation": ("simulation, 1500 rpm, slow", partial(load_config, "paper_simulation")),
    "testbench": ("test bench, 1000 rpm, slow", partial(load_config, "paper_testbench")),
    # R and the map part by themselves: slow, and fast in current.
    "well_designed": ("simulation, 150 rpm, fast", partial(load_config, "well_designed")),
    "well_designed_testbench": ("test bench, 150 rpm, fast", _well_designed_testbench),
    "motor_operation": ("simulation, motor operation", _motor_operation),
    "operating_points": ("simulation, operating points", _operating_points),
}


def fingerprint(name: str) -> str:
    """Return a hash that differs between cases (keys of `CASES`) recorded differently."""
    whole = CASES[name][1]()
    text = json.dumps(plain([whole, _others(name, whole)]), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def record_case(name: str, extent: Extent) -> Case:
    """Record a case of `CASES`, as long and with as many unseen recordings as the extent says."""
    label, make = CASES[name]
    whole = make()
    share = 1.0 if name == "operating_points" else extent.share
    trained = replace(whole, duration=whole.duration * share).record()
    rippled = isinstance(whole.speed_rpm, SpeedRipple)
    unseen = []
    for number, (rpm, reference) in enumerate(_others(name, whole)[: extent.unseen]):
        speed: Speed = SpeedRipple(rpm, _RIPPLE) if rippled else rpm
        other = replace(
            whole,
            reference=reference,
            speed_rpm=speed,
            duration=extent.unseen_duration,
            seed=whole.seed + 1 + number,
        )
        run = other.record()
        called = f"{rpm:g} rpm, {type(reference).__name__.lower()}"
        unseen.append(replace(run, experiment=replace(run.experiment, name=called)))
    return Case(name, label, trained, tuple(unseen))


def _others(name: str, whole: Simulation) -> list[tuple[float, Reference]]:
    """Return speeds in rpm and trajectories within the currents that were learned from."""
    amplitude = getattr(whole.reference, "amplitude", 240.0)
    if name == "motor_operation":
        rates = ((14.0, 15.0), (40.0, 33.0), (60.0, 50.0), (90.0, 100.0))
        speeds = (2500.0, 900.0, 500.0, 3000.0, 1500.0, 2000.0, 1200.0, 600.0)
        return [
            (rpm, Lissajous((0.95, 0.7)[k % 2] * amplitude, *rates[k % 4], MOTOR))
            for k, rpm in enumerate(speeds)
        ]
    return [
        (900.0, Lissajous(0.8 * amplitude, 40.0, 33.0)),
        (2500.0, Lissajous(0.6 * amplitude, 60.0, 50.0)),
        (500.0, Lissajous(0.95 * amplitude, 14.0, 15.0)),
        (-1000.0, Lissajous(0.8 * amplitude, 23.0, 31.0)),
        (3000.0, Lissajous(0.9 * amplitude, 40.0, 47.0, MOTOR)),
        (2000.0, Lissajous(0.9 * amplitude, 47.0, 40.0, GENERATOR)),
        (1500.0, Spiral(0.9 * amplitude, 80.0, 0.2)),
        (1200.0, stationary_grid(0.9 * amplitude, points=4, dwell=0.02)),
    ]
