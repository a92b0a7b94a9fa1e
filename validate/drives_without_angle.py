"""Coverage on drives that log no angle of the rotor.

``python -m validate.drives_without_angle [N] [K]``: draws of `validate.imperfect_drives`, without
their column theta_el: what an inverter takes of each phase is known as its mean along the current
alone, and no harmonic of the angle is. Each is one run of ``penode identify`` from a file, nothing
given, report included. Ctrl-C prints the table so far; the same command goes on.
"""

from dataclasses import replace

from validate.identified import identified
from validate.imperfect_drives import draw
from validate.ledger import Record, run_draws
from validate.misfitting_drives import line_of, print_table, record_of

COUNT = 40


def result_of(number: int) -> Record:
    """Identify one draw without its angle."""
    run, truth, there, _ = draw(number)
    bare = {name: one for name, one in run.channels.items() if name != "theta_el"}
    done = identified(f"drives_without_angle/{number}", [replace(run, channels=bare)])
    law = "switch" if "inverter" in there else "ideal"
    return record_of(done, truth, law, ", ".join(sorted(there)))


if __name__ == "__main__":
    run_draws("drives_without_angle", COUNT, result_of, line_of, print_table)
