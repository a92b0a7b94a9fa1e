"""The default identification, whole, with its answer beside its time; and with a map of i alone."""

import time

from penode.pmsm.bench.machines import TRACTION_300A
from penode.pmsm.bench.references import Lissajous
from penode.pmsm.bench.run import simulate
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

#: What the data decide, and the smaller model of the paper.
STUDIES = {
    "decided from the data": Study(),
    "map of i alone": Study(candidates=(), angle_orders=()),
}


def main() -> None:
    """Print time and error of the default identification, first cold and then compiled."""
    run = simulate(TRACTION_300A, Lissajous(240.0, 14.0, 15.0), speed_rpm=1500.0, duration=2.0)
    print("Default identification, 2 s at 10 kHz, whole ladder to H = 200")
    for name, study in STUDIES.items():
        times = []
        for state in ("cold", "warm"):
            began = time.perf_counter()
            fit = identify([run], study=study)
            times.append(time.perf_counter() - began)
            error = 100 * (fit.parameters["R"].value / TRACTION_300A.resistance - 1)
            told = f"H = {fit.horizon.selected}, R error {error:+.2f} %"
            print(f"{name:>22}, {state} {times[-1]:6.1f} s   {told}")
        print(f"warm/cold {times[1] / times[0]:.2f}x")


if __name__ == "__main__":
    main()
