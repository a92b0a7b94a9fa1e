"""Permanent-magnet synchronous machines: flux-linkage map and resistance from a drive recording.

From a recording to a result
    `load_study` or `guess_study`, `check_recordings`, `check_points`; `identify` with a `Study`
    and the `Accuracy` of the bench, `identify_points` where all stand still,
    `identify_with_points` where both were recorded; `drive_recording` of phases for what a fit
    is asked of them; `write`.
What the result is used for
    `export`, `ControlledMachine`, `control_loci`, `mtpa` and `operating_points`, `compare_maps`,
    `torque_of` a recording.
What the model is made of
    `Machine`: a flux map and terms (`TERMS`; write your own as a `Term`).

Whatever else is used by a few is imported from its own module.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
