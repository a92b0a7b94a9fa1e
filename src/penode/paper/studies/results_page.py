"""The results page: what came out, in words, tables and figures, as Markdown."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from penode.paper.studies.panels import StudyResult
from penode.paper.studies.summaries import texts

_WORDS = {True: "Holds", False: "Differs", None: "Not judged"}

_HEADINGS = {
    "R_mohm": "R (mΩ)",
    "R_error_percent": "error of R (%)",
    "flux_mae_percent_of_psi_PM": "map (% of ψ_PM)",
    "one_step_mse_unseen_A2": "one step, unseen (A²)",
    "free_run_rmse_unseen_A": "free run, unseen (A)",
    "wall_time_s": "time (s)",
}


def results_page(results: Sequence[StudyResult], facts: Mapping[str, Any]) -> str:
    """Return the page, with figures linked as ``figures/studies_NAME.png``.

    ``facts`` has ``machine``, ``python``, ``versions``, ``extent`` and ``wall_time_s``.
    """
    words, extent = texts()["page"], facts["extent"]
    quick = extent["name"] == "quick"
    made = words["made"].format(
        command="penode reproduce all --out DIR" + (" --quick" if quick else ""),
        machine=facts["machine"],
        python=facts["python"],
        versions=", ".join(f"{name} {number}" for name, number in facts["versions"].items()),
        minutes=facts["wall_time_s"] / 60,
        growth=", ".join(map(str, extent["growth"])),
        growth_steps=extent["growth_steps"],
        steps=extent["steps"],
    )
    parts = [words["head"], *([words["quick"]] if quick else []), _summary(results)]
    parts += [words["reading"], *map(_section, results), f"## How it was made\n\n{made}"]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


def _summary(results: Sequence[StudyResult]) -> str:
    lines = ["## In short", "", "| study | holds | differs |", "|---|---|---|"]
    for result in results:
        anchor = "".join(c for c in result.title.lower() if c.isalnum() or c in " -")
        name = f"[{result.title}](#{anchor.replace(' ', '-')})"
        counts: tuple[object, object] = (result.count(True), result.count(False))
        if result.count(None):
            counts = ("not judged", "not judged")
        lines.append(f"| {name} | {counts[0]} | {counts[1]} |")
    return "\n".join(lines)


def _section(result: StudyResult) -> str:
    lines = [f"## {result.title}", "", result.question, ""]
    lines += [f"![{result.title}](figures/studies_{result.name}.png)", ""]
    for claim in result.claims:
        lines.append(f"- **{_WORDS[claim.holds]}.** {claim.text}")
        if claim.holds is not None:
            lines.append(f"  {claim.evidence}")
    lines += ["", result.reading]
    shown = [name for name in result.columns if name != "refusal"]
    if shown:
        heads = [_HEADINGS.get(name, name.replace("_", " ")) for name in shown]
        lines += ["", f"| {' | '.join(heads)} |", "|" + "---|" * len(shown)]
        for row in result.rows:
            lines.append(f"| {' | '.join(_cell(row.get(name)) for name in shown)} |")
    return "\n".join(lines)


def _cell(value: object) -> str:
    """Return a number as the page has it: a dash for none, as where a method refused."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.3g}" if math.isfinite(value) else "diverges"
    return str(value)
