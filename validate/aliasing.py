"""Windows end to end against jittered ones: ``python -m validate.aliasing``.

At 1000 rpm and 10 kHz the sixth harmonic of a machine with five pole pairs has a period of 20
samples. Windows end to end whose horizon is a multiple of it all start at one phase of the
harmonic, which then looks like a constant. Printed is the error of R at horizons around three
multiples, trained with both placements up the same ladder, for a map without angle orders.
"""

from dataclasses import replace

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.windows import Contiguous, Jittered, Placement
from penode.horizon.identifiability import Start
from penode.horizon.ladder import ladder_plan
from penode.horizon.selection import Longest
from penode.identify import identify
from penode.pmsm.balance.start import weak_start

PERIOD = 20
HORIZONS = (12, 16, 18, 20, 22, 24, 30, 36, 38, 40, 42, 44, 50, 56, 58, 60, 62, 64)


def errors(placement: Placement) -> dict[int, float]:
    """Return the relative error of R in per cent at each horizon."""
    machine = TRACTION_300A
    reference = Lissajous(0.8 * machine.current_limit, 49 / 12, 50 / 12)
    run = simulate(machine, reference, speed_rpm=1000.0, duration=3.0)
    machine_start = weak_start([run], "coenergy")
    start = Start(machine_start.machine, penalties=machine_start.penalties)
    plan = replace(ladder_plan(HORIZONS), placement=placement, detour=None)
    ladder = identify(start, [run], plan=plan, purpose=Longest()).horizon.ladder
    return {r.horizon: 100 * (r.parameters["R"] / machine.resistance - 1) for r in ladder}


def hump(found: dict[int, float], horizon: int) -> float:
    """Return how far a horizon stands out of its neighbours, two samples to either side."""
    return found[horizon] - 0.5 * (found[horizon - 2] + found[horizon + 2])


def main() -> None:
    """Print the table."""
    both = [errors(placement) for placement in (Contiguous(), Jittered(0))]
    print("   H  error of R in %, end to end and jittered")
    for horizon in HORIZONS:
        mark = "  <- whole periods" if horizon % PERIOD == 0 else ""
        end_to_end, jittered = (one[horizon] for one in both)
        print(f"{horizon:4d} {end_to_end:+10.2f} {jittered:+10.2f}{mark}")
    for horizon in (h for h in HORIZONS if h % PERIOD == 0):
        end_to_end, jittered = (hump(one, horizon) for one in both)
        print(
            f"H = {horizon} stands out of its neighbours by {end_to_end:+.1f} points end to end, "
            f"by {jittered:+.1f} jittered."
        )


if __name__ == "__main__":
    main()
