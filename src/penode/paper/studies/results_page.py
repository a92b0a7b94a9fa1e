"""The results page: what came out, in words, tables and figures, as Markdown."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from penode.paper.studies.panels import StudyResult

_HEAD = """# The paper, figure by figure, and ours beside it

Written by `penode reproduce`; not to be edited by hand. Every experiment of the paper is rebuilt on
the simulated bench, whose truth no method sees, with the paper's training and then with ours, step
by step: Levenberg-Marquardt instead of Adam, jittered windows, a coenergy map, the inverter term,
angle harmonics, and the horizon chosen from the data.
"""

_QUICK = """
**This is a quick run: short recordings and hardly any training. It shows that everything runs; its
numbers prove nothing, and its statements are not judged.**
"""

_WORDS = {True: "Holds", False: "Differs", None: "Not judged"}

_READING = """
## How to read it

- The **true R** is the dashed line. A method that is far from it and whose seeds agree is not sure
  but biased: repeating the training does not reveal a bias.
- **H** is how many samples ahead the training looks. If R moves with H, neither end is the answer;
  something in the recording is not in the model. Look for a range where it stands still.
- For your own drive the cheapest remedies come first: a map with a coenergy, a recording at a
  second speed or both directions, fast currents at low speed; the inverter term wherever dead time
  is not compensated. The horizon comes after these.
- **One-step** errors say how good an observer or a controller's predictor would be, **free-run**
  errors how good a simulation. A small one-step error on the training recording says nothing of R.
"""


def results_page(results: Sequence[StudyResult], facts: Mapping[str, Any]) -> str:
    """Return the page, with figures linked as ``figures/studies_NAME.png``.

    ``facts`` has ``machine``, ``python``, ``versions``, ``extent`` and ``wall_time_s``.
    """
    small = _QUICK if facts["extent"]["name"] == "quick" else ""
    parts = [_HEAD + small, _summary(results), _READING, *map(_section, results), _made(facts)]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


def _summary(results: Sequence[StudyResult]) -> str:
    lines = ["## In short", "", "| study | holds | differs |", "|---|---|---|"]
    for result in results:
        name = f"[{result.title}](#{_anchor(result.title)})"
        held, differ = result.count(True), result.count(False)
        untried = any(claim.holds is None for claim in result.claims)
        counts = ("not judged", "not judged") if untried else (held, differ)
        lines.append(f"| {name} | {counts[0]} | {counts[1]} |")
    return "\n".join(lines)


def _anchor(title: str) -> str:
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -")
    return kept.replace(" ", "-")


def _section(result: StudyResult) -> str:
    lines = [f"## {result.title}", "", result.question, ""]
    lines += [f"![{result.title}](figures/studies_{result.name}.png)", ""]
    for claim in result.claims:
        lines.append(f"- **{_WORDS[claim.holds]}.** {claim.text}")
        if claim.holds is not None:
            lines.append(f"  {claim.evidence}")
    lines += ["", result.reading]
    if result.columns:
        lines += ["", *_table(result.rows, result.columns)]
    return "\n".join(lines)


def _table(rows: Sequence[Mapping[str, object]], columns: Sequence[str]) -> list[str]:
    """Return rows as a Markdown table, a refusal shown as a dash."""
    shown = [name for name in columns if name != "refusal"]
    lines = ["| " + " | ".join(_heading(name) for name in shown) + " |"]
    lines.append("|" + "---|" * len(shown))
    for row in rows:
        lines.append("| " + " | ".join(_cell(row.get(name)) for name in shown) + " |")
    return lines


_HEADINGS = {
    "R_mohm": "R (mΩ)",
    "R_error_percent": "error of R (%)",
    "flux_mae_percent_of_psi_PM": "map (% of ψ_PM)",
    "one_step_mse_unseen_A2": "one step, unseen (A²)",
    "free_run_rmse_unseen_A": "free run, unseen (A)",
    "wall_time_s": "time (s)",
}


def _heading(name: str) -> str:
    return _HEADINGS.get(name, name.replace("_", " "))


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.3g}" if math.isfinite(value) else "diverges"
    return str(value)


def _made(facts: Mapping[str, Any]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in facts["versions"].items())
    extent = facts["extent"]
    command = "penode reproduce all --out DIR" + (" --quick" if extent["name"] == "quick" else "")
    minutes = facts["wall_time_s"] / 60
    return "\n".join(
        [
            "## How it was made",
            "",
            f"`{command}` on {facts['machine']}; Python {facts['python']}, {versions}. All "
            f"trainings together took {minutes:.0f} min: wall times, beside whatever else the "
            "machine did; the files of every study give processor times too. Nothing of the "
            "simulated drives was tuned for these studies: they are the shipped configurations.",
            "",
            "The paper's recipe: horizons grow through "
            f"{', '.join(map(str, extent['growth']))} with {extent['growth_steps']} gradient steps "
            f"each, then {extent['steps']} at the horizon itself, in batches of 1000 samples. The "
            "paper leaves these numbers open. What the horizons of a seed have in common is "
            "trained once, which changes no result. A dash stands where a method refused the "
            "recording: stationary averaging where nothing dwells.",
        ]
    )
