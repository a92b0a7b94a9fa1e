"""Recordings written to files and identified by the command, and what was wrong on the way."""

import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from penode.data.experiment import Experiment
from penode.data.save import save
from penode.fit.fit import Fit
from penode.pmsm.recording.imperfections import DEFAULT_ACCURACY
from validate.command import Ended, identify
from validate.ledger import Record

FOLDER = Path("out") / "validate"
#: Exit statuses that the command promises: done, no answer, unusable input.
_PROMISED = (0, 1, 2)
#: A study file that says that simulated sensors are exact.
EXACT = "\n".join(["[accuracy]", *(f"{name} = 0.0" for name in DEFAULT_ACCURACY.declared)]) + "\n"


@dataclass(frozen=True, eq=False)
class Identified:
    """How recordings ended.

    Attributes
    ----------
    fit : Fit or None
        Loaded from the files that were written; None where there are none.
    verdict : str
        Of the fit; ``"refused"`` where the input was, ``"status 70"`` where penode failed.
    why : str
        The reason of the verdict, or the last line printed.
    noted : str
        What no run should show: another exit status than 0, 1 or 2, parts of the report left out,
        warnings of Python. Empty for nothing.
    seconds : float
        Wall time of the command, report included.
    """

    fit: Fit | None
    verdict: str
    why: str
    noted: str
    seconds: float

    def resistance(self, truth: float) -> Record:
        """Return R's error over a truth in ohm, whether it is covered, and objections; or nothing.

        Error and deviation are fractions of the truth.
        """
        if self.fit is None:
            return {}
        estimate = self.fit.parameters["R"]
        low, high = estimate.interval_95
        return {
            "objections": [one.name for one in self.fit.horizon.objections],
            "error": estimate.value / truth - 1,
            "covered": bool(low <= truth <= high),
            "std": estimate.std / truth,
        }

    @property
    def told(self) -> str:
        """What is noted, for the end of a line of a table."""
        return f"  !! {self.noted}" if self.noted else ""


def identified(
    name: str, recordings: Sequence[Experiment], *options: object, config: str = ""
) -> Identified:
    """Write recordings to ``out/validate/NAME`` and identify them with the command.

    Parameters
    ----------
    name : str
        Of the folder. It is deleted after the fit was loaded, unless something is noted.
    recordings : sequence of Experiment
    *options : object
        Of ``penode identify``.
    config : str
        Content of a study file.
    """
    folder = FOLDER / re.sub(r"[^\w/]+", "_", name)
    shutil.rmtree(folder, ignore_errors=True)
    files = [folder / f"recording{k}.csv" for k in range(1, len(recordings) + 1)]
    for recording, file in zip(recordings, files, strict=True):
        save(recording, file)
    if config:
        (folder / "study.toml").write_text(config)
        options = (*options, "--config", folder / "study.toml")
    done = outcome(identify(files, folder / "result", *options))
    if not done.noted:
        shutil.rmtree(folder)
    return done


def outcome(ended: Ended) -> Identified:
    """Return how a command ended, its fit loaded."""
    noted = [] if ended.status in _PROMISED else [f"exit status {ended.status}: {ended.last_line}"]
    noted += [line.strip() for line in ended.printed.splitlines() if "please send in" in line]
    noted += dict.fromkeys(line for line in ended.warned if line.startswith("RuntimeWarning"))
    text = "; ".join(noted)
    if ended.result is None:
        verdict = "refused" if ended.status in _PROMISED else f"status {ended.status}"
        return Identified(None, verdict, ended.last_line, text, ended.seconds)
    fit = ended.fit()
    return Identified(fit, fit.horizon.verdict, fit.horizon.reason, text, ended.seconds)
