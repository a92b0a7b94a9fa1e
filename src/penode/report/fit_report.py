"""The report of any fit: the answer first, then a section for each question a reader may ask.

To add a section, write a function from a fit to a `Section` beside those of
`penode.report.sections`, and name it in `PARTS`; pages that replace some of these with sections of
their own (`Page.own`) then have it too.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeAlias

from penode.fit.fit import Fit
from penode.fit.outcome import IMPLAUSIBLE, NORMAL_95
from penode.report.document import (
    Block,
    Document,
    Glossary,
    KeyValue,
    KeyValues,
    Section,
    attempt,
    missing,
)
from penode.report.html import render
from penode.report.points_section import points_balance
from penode.report.quantities import number, scale_for
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
    free_run_value,
    listed,
    one_step_value,
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
    points_balance,
    learned_maps,
    predictions,
    residual_section,
    loss_weighting,
    horizons,
    provenance,
)


#: Parameters named in the heading at most.
_NAMED = 4
_WORDS = (
    ("Horizon H", "How many samples ahead the model predicts by itself during training, from the "
     "states at the start, measured or estimated, and the inputs after that."),
    ("One step ahead", "Each sample predicted from what was measured just before it. Easy to do "
     "well, and therefore a weak test; noise counts twice in it, as it starts from a sample, so "
     "that a free run may err less."),
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
    the first paragraph what was fitted; ``own`` are parts that replace one of ``parts``; ``words``
    are explained beside those of every report, ``beside`` gives further values of the answer.
    """

    kind: str = "Identification"
    headline: tuple[str, ...] = ()
    method: str = "so that the model predicts what was measured"
    parts: tuple[Part, ...] = PARTS
    own: Mapping[Part, Sequence[Part]] = field(default_factory=dict)
    beside: Callable[[Fit], Sequence[KeyValue]] = lambda _: ()
    words: tuple[tuple[str, str], ...] = ()

    def all_parts(self) -> tuple[Part, ...]:
        """Return the parts in order, the page's own in their places."""
        return tuple(one for part in self.parts for one in self.own.get(part, (part,)))

    def document(self, fit: Fit) -> Document:
        """Return the report of a fit as a document."""
        names = (self.headline or tuple(fit.parameters))[:_NAMED]
        others = [one for one in fit.warnings if one != fit.horizon.reason]
        answer: list[Block] = [
            attempt("the verdict", partial(verdict_notice, fit.horizon), missing),
            *attempt("the warnings", partial(warning_notices, others), lambda why: [missing(why)]),
            attempt("the values", partial(_key_values, fit, names, self), missing),
            Glossary("The words used here", (*_WORDS, *self.words)),
        ]
        sections = [_section(part, fit) for part in self.all_parts()]
        title = attempt("the heading", partial(_title, fit, names), lambda _: self.kind)
        lead = attempt("the first paragraph", partial(_first_paragraph, fit, names, self), str)
        return Document(self.kind, title, lead, answer, [one for one in sections if one])


def fit_report(fit: Fit, page: Page | None = None) -> str:
    """Return the report of a fit of any model as one self-contained HTML page, UTF-8."""
    return render((page or Page()).document(fit))


def _section(part: Part, fit: Fit) -> Section | None:
    """Return a section, or one that says it is left out, after the name of its function."""
    subject = getattr(part, "__name__", "results").removesuffix("_section").replace("_", " ")
    lead = "This section is left out. The answer and the other sections do not depend on it."
    title = f"{subject[:1].upper()}{subject[1:]}"
    return attempt(
        f"the section on {subject}",
        partial(part, fit),
        lambda why: Section(title, lead, [missing(why)]),
    )


def _title(fit: Fit, names: Sequence[str]) -> str:
    values = [estimate_text(fit.parameters[name])[0] for name in names]
    if not names:
        return f"A model of {listed(fit.model.states)}"
    several, meaning = len(names) > 1, fit.parameters[names[0]].meaning
    what = listed(names) if several else f"the {meaning}" if meaning else names[0]
    if fit.horizon.verdict == IMPLAUSIBLE:
        return f"No answer on {what}: the model does not explain these recordings"
    if not fit.horizon.answered:
        return f"These recordings cannot determine {'all of ' if several else ''}{what}"
    if several:
        return listed([f"{name} = {value}" for name, value in zip(names, values, strict=True)])
    return f"{what[0].upper()}{what[1:]} is {values[0]}"


def _first_paragraph(fit: Fit, names: Sequence[str], page: Page) -> str:
    """Say where the values lie and what they were fitted to."""
    answered, single = fit.horizon.answered, len(names) == 1
    spans = [
        estimate_text(fit.parameters[name])[1] if answered else _spread(fit, name) for name in names
    ]
    intervals = ""
    if answered and single:
        between = spans[0].replace(" to ", " and ")
        intervals = f"With 95 % confidence it lies between {between}{_of_sensors(fit, names[0])}. "
    elif answered and names:
        both = [f"{name} {span}" for name, span in zip(names, spans, strict=True)]
        intervals = f"95 % intervals: {listed(both)}. "
    elif names:
        both = [f"{span} for {name}" for name, span in zip(names, spans, strict=True)]
        intervals = f"The horizons tried gave values from {listed(spans if single else both)}. "
    trained = [one.name for one in fit.recordings if one.role == "train"]
    source = trained[0] if len(trained) == 1 else f"{len(trained) or 'the training'} recordings"
    if fit.stationary:
        source = f"{source} and {fit.stationary.name}" if trained else fit.stationary.name
    subject = "Each was" if not answered else "It was" if len(names) < 2 else "They were"
    return f"{intervals}{subject} fitted to {source} {page.method}."


def _of_sensors(fit: Fit, name: str) -> str:
    """Say that most of an interval is the accuracy of the sensors, where it is."""
    estimate = fit.parameters[name]
    if not estimate.sensor_std**2 > 0.5 * estimate.std**2:
        return ""
    assumed = any(row.origin == "assumed" for row in estimate.budget)
    scale = scale_for(estimate.value, estimate.unit)
    half = number(NORMAL_95 * estimate.statistical_std * scale.factor, 2)
    alone = f"{half}\N{NO-BREAK SPACE}{scale.unit}"
    which = "assumed of the sensors; give your own" if assumed else "declared of the sensors"
    return f", mostly by the accuracy {which} (the data alone: ±\N{NO-BREAK SPACE}{alone})"


def _spread(fit: Fit, name: str) -> str:
    values = [rung.parameters[name] for rung in fit.horizon.ladder if name in rung.parameters]
    return range_text(values, fit.parameters[name].unit)


def _key_values(fit: Fit, names: Sequence[str], page: Page) -> KeyValues:
    choice = fit.horizon
    errors = (free_run_value(fit.recordings), one_step_value(fit.recordings))
    detail = choice.verdict
    if fit.comparisons:
        ahead = 1e3 * min(one.time_step for one in fit.comparisons) * choice.selected
        detail = f"{number(ahead, 2)}\N{NO-BREAK SPACE}ms ahead; {choice.verdict}"
        if choice.verdict == "plateau":
            detail += f" from H = {min(choice.plateau)} to {max(choice.plateau)}"
    horizon = KeyValue("Horizon", f"H = {choice.selected}", detail, choice.selected)
    values = [_parameter_value(fit, name) for name in names]
    ahead_of = (horizon,) if choice.selected else ()
    return KeyValues((*values, *page.beside(fit), *filter(None, errors), *ahead_of))


def _parameter_value(fit: Fit, name: str) -> KeyValue:
    estimate = fit.parameters[name]
    label = f"{estimate.meaning[:1].upper()}{estimate.meaning[1:]} {name}".lstrip()
    if not fit.horizon.answered:
        detail = f"{_spread(fit, name)} over the horizons"
        return KeyValue(label, "no answer", detail, doubtful=True)
    value, interval = estimate_text(estimate)
    return KeyValue(label, value, f"95 % interval {interval}", estimate.value)
