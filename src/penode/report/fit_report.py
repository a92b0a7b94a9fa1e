"""The report of any fit: the answer first, then a section for each question a reader may ask.

To add a section, write a function from a fit to a `Section` beside those of
`penode.report.sections`, and name it in `PARTS`; pages that replace some of these with sections of
their own (`with_own`) then have it too.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

from penode.fit.fit import Fit
from penode.report.document import Block, Document, Glossary, KeyValue, KeyValues, Section
from penode.report.guard import attempt, missing
from penode.report.html import render
from penode.report.prediction_errors import free_run_value, one_step_value
from penode.report.quantities import number
from penode.report.sections import (
    horizons,
    learned_maps,
    loss_weighting,
    parameters,
    predictions,
    provenance,
    residual_section,
)
from penode.report.statements import (
    estimate_text,
    listed,
    range_text,
    verdict_notice,
    warning_notices,
)
from penode.report.uncertainty_budget import uncertainty_budget

#: A part of the report: a section, or None where the fit has nothing to show in it.
Part: TypeAlias = Callable[[Fit], Section | None]

#: The sections of any fit, in order.
PARTS: tuple[Part, ...] = (
    parameters,
    uncertainty_budget,
    learned_maps,
    predictions,
    residual_section,
    loss_weighting,
    horizons,
    provenance,
)


def with_own(own: Mapping[Part, Sequence[Part]], parts: Sequence[Part] = PARTS) -> tuple[Part, ...]:
    """Return parts of a report, in order, some replaced by the parts that ``own`` holds."""
    return tuple(one for part in parts for one in own.get(part, (part,)))


#: Parameters named in the heading at most.
_NAMED = 4
_WORDS = (
    ("Horizon H", "How many samples ahead the model predicts by itself during training, from the "
     "measured states at the start and the inputs after that."),
    ("One step ahead", "Each sample predicted from the measured one before it (H = 1). Easy to "
     "do well, and therefore a weak test."),
    ("Free run", "A whole recording predicted from its first sample, without the measured states "
     "after it. The hardest test: errors may add up."),
    ("Plateau", "Neighbouring horizons whose estimates agree within their uncertainty. The "
     "sign that a physical parameter is right and not an artefact of the horizon."),
    ("95 % interval", "Where the parameter lies with 95 % confidence if the model's structure "
     "is right and the sensors are as accurate as the uncertainty budget assumes."),
)  # fmt: skip


@dataclass(frozen=True)
class Page:
    """What the report of fits of one kind consists of; the defaults do for any model.

    ``headline`` names the parameters whose values are the answer, empty for all; ``method`` says in
    the first paragraph what was fitted; ``words`` are explained beside those of every report.
    """

    kind: str = "Identification"
    headline: tuple[str, ...] = ()
    method: str = "so that the model predicts the measured states"
    parts: tuple[Part, ...] = PARTS
    words: tuple[tuple[str, str], ...] = ()

    def document(self, fit: Fit) -> Document:
        """Return the report of a fit as a document."""
        names = (self.headline or tuple(fit.parameters))[:_NAMED]
        others = [one for one in fit.warnings if one != fit.horizon.reason]
        answer: list[Block] = [
            attempt("the verdict", partial(verdict_notice, fit.horizon), missing),
            *attempt("the warnings", partial(warning_notices, others), lambda why: [missing(why)]),
            attempt("the values", partial(_key_values, fit, names), missing),
            Glossary("The words used here", (*_WORDS, *self.words)),
        ]
        made = [
            attempt(_named(part), partial(part, fit), partial(_absent, part)) for part in self.parts
        ]
        sections = [section for section in made if section is not None]
        title = attempt("the heading", partial(_title, fit, names), lambda _: self.kind)
        lead = attempt("the first paragraph", partial(self._lead, fit, names), str)
        return Document(self.kind, title, lead, answer, sections)

    def _lead(self, fit: Fit, names: Sequence[str]) -> str:
        return f"{_interval_sentence(fit, names)}{_source_sentence(fit, names)} {self.method}."


def _subject(part: Part) -> str:
    """Return what a section is about, by the name of its function."""
    return getattr(part, "__name__", "results").removesuffix("_section").replace("_", " ")


def _named(part: Part) -> str:
    return f"the section on {_subject(part)}"


def _absent(part: Part, why: str) -> Section:
    """Return the section in the place of one that is left out."""
    subject = _subject(part)
    return Section(
        f"{subject[:1].upper()}{subject[1:]}",
        "This section is left out. The answer and the other sections do not depend on it.",
        [missing(why)],
    )


def fit_report(fit: Fit, page: Page | None = None) -> str:
    """Return the report of a fit of any model as one self-contained HTML page, UTF-8."""
    return render((page or Page()).document(fit))


def _title(fit: Fit, names: Sequence[str]) -> str:
    if not names:
        return f"A model of {listed(fit.model.states)}"
    if len(names) == 1:
        what = _what(fit, names[0])
        if not fit.horizon.answered:
            return f"These recordings cannot determine {what}"
        return f"{what[0].upper()}{what[1:]} is {estimate_text(fit.parameters[names[0]])[0]}"
    if not fit.horizon.answered:
        return f"These recordings cannot determine all of {listed(names)}"
    return listed([f"{name} = {estimate_text(fit.parameters[name])[0]}" for name in names])


def _what(fit: Fit, name: str) -> str:
    meaning = fit.parameters[name].meaning
    return f"the {meaning}" if meaning else name


def _interval_sentence(fit: Fit, names: Sequence[str]) -> str:
    if not names:
        return ""
    if not fit.horizon.answered:
        spreads = [_spread(fit, name) for name in names]
        if len(names) > 1:
            spreads = [f"{spread} for {name}" for name, spread in zip(names, spreads, strict=True)]
        return f"The horizons tried gave values from {listed(spreads)}. "
    spans = [estimate_text(fit.parameters[name])[1] for name in names]
    if len(names) == 1:
        return f"With 95 % confidence it lies between {spans[0].replace(' to ', ' and ')}. "
    intervals = [f"{name} {span}" for name, span in zip(names, spans, strict=True)]
    return f"95 % intervals: {listed(intervals)}. "


def _source_sentence(fit: Fit, names: Sequence[str]) -> str:
    trained = [one.name for one in fit.recordings if one.role == "train"]
    source = "the training recordings"
    if len(trained) == 1:
        source = trained[0]
    elif trained:
        source = f"{len(trained)} recordings"
    subject = "It was" if len(names) < 2 else "They were"
    return f"{subject if fit.horizon.answered else 'Each was'} fitted to {source}"


def _spread(fit: Fit, name: str) -> str:
    values = [rung.parameters[name] for rung in fit.horizon.ladder if name in rung.parameters]
    return range_text(values, fit.parameters[name].unit)


def _key_values(fit: Fit, names: Sequence[str]) -> KeyValues:
    choice = fit.horizon
    items = [_parameter_value(fit, name) for name in names]
    errors = (free_run_value(fit.recordings), one_step_value(fit.recordings))
    items += [item for item in errors if item is not None]
    detail = choice.verdict
    if fit.comparisons:
        ahead = 1e3 * fit.comparisons[0].time_step * choice.selected
        detail = f"{number(ahead, 2)}\N{NO-BREAK SPACE}ms ahead; {choice.verdict}"
    items.append(KeyValue("Horizon", f"H = {choice.selected}", detail, choice.selected))
    return KeyValues(tuple(items))


def _parameter_value(fit: Fit, name: str) -> KeyValue:
    estimate = fit.parameters[name]
    label = f"{estimate.meaning[:1].upper()}{estimate.meaning[1:]} {name}".lstrip()
    if not fit.horizon.answered:
        detail = f"{_spread(fit, name)} over the horizons"
        return KeyValue(label, "no answer", detail, doubtful=True)
    value, interval = estimate_text(estimate)
    return KeyValue(label, value, f"95 % interval {interval}", estimate.value)
