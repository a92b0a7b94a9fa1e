"""The table of drawn physics: a line a kind, then all of either sort."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from validate.ledger import Record
from validate.physics.outcome import best_of, covered, is_right, large

HEAD = (
    "                     positive   covered  infinite  |e|/half   right: implausible, not    "
    "error  over best: chosen first   last  seconds: first later compiled"
)


def line_of(one: Record) -> str:
    """Return the line of a draw."""
    head = f"{one['draw']:22.22s} {one['verdict']:15.15s} {one['seconds']:5.0f} s"
    if one["rungs"]:
        inside, best = covered(one), best_of(one["rungs"])
        each = ", ".join(
            f"{name} {100 * (one['values'][name] / true - 1):+.2g} ± {_half(one, name)}"
            + "*" * (not inside[name])
            for name, true in one["truth"].items()
        )
        ladder = (
            f"H {one['selected']} of {one['rungs'][0]['horizon']}-{one['rungs'][-1]['horizon']}"
        )
        head += f" {ladder} error {100 * large(one['error']):.2g} (best {100 * best:.2g}) % "
        head += f"fresh {large(one['fresh']):.2f} {'right' if is_right(one) else 'wrong'}: {each}"
    said = ", ".join(dict.fromkeys(one.get("objections", ())))
    said = one["reason"] if one["verdict"] not in ("plateau", "H = 1 suffices") else said
    return f"{head}; {said}" + "".join(f" !! {warned}" for warned in one["warned"])


def _half(one: Record, name: str) -> str:
    half = one["half"][name]
    return "inf" if half is None else f"{100 * half / one['truth'][name]:.2g} %"


def print_table(draws: Sequence[Record]) -> None:
    """Print a line a kind, of both sorts and of all, and what right ones were refused for."""
    print(f"\n{HEAD}")
    for name in dict.fromkeys(one["physics"] for one in draws):
        print(row(name, [one for one in draws if one["physics"] == name]))
    sorts = ("WELL SPECIFIED", (False,)), ("MISFITTING", (True,)), ("ALL", (False, True))
    for sort, misfits in sorts:
        some = [one for one in draws if one["misfits"] in misfits]
        if some:
            print(row(sort, some))
    refused = [one for one in draws if is_right(one) and not one["positive"]]
    for cause, count in Counter(map(cause_of, refused)).most_common():
        names = dict.fromkeys(one["physics"] for one in refused if cause_of(one) == cause)
        print(f"right, but {cause}: {count} ({', '.join(names)})")


def cause_of(one: Record) -> str:
    """Return the verdict of a draw, with the first objection."""
    return ": ".join([one["verdict"], *one["objections"][:1]])


def row(name: str, draws: Sequence[Record]) -> str:
    """Return the figures of some draws, as a line below `HEAD`."""
    positive = [one for one in draws if one["positive"]]
    right = [one for one in draws if is_right(one)]
    finite = [(one, key) for one in positive for key, half in one["half"].items() if half]
    missing = sum(len(one["half"]) for one in positive) - len(finite)
    inside = sum(covered(one)[key] for one, key in finite)
    sizes = [abs(one["values"][key] - one["truth"][key]) / one["half"][key] for one, key in finite]
    implausible = sum(one["verdict"] == "implausible" for one in right)
    refused = sum(not one["positive"] for one in right)
    ratios = _ratios([one for one in draws if one["rungs"]])
    first = min(one["number"] for one in draws)
    cold = [one["seconds"] for one in draws if one["number"] == first]
    warm = [one["seconds"] for one in draws if one["number"] > first]
    programs = [one["compiled"] for one in draws if one["number"] > first]
    share = 100 * inside / len(finite) if finite else np.nan
    return (
        f"{name:20.20s} {len(positive):4d}/{len(draws):3d} {inside:4d}/{len(finite):4d} "
        f"{share:4.0f} % {missing:4d} {_middle(sizes):8.2f} {len(right):8d} {implausible:8d} "
        f"{refused:8d} {100 * _middle([large(o.get('error')) for o in draws]):8.2g} % "
        f"{ratios[0]:12.3g} {ratios[1]:6.3g} {ratios[2]:6.3g} {_middle(cold):11.0f} "
        f"{_middle(warm):5.0f} {_middle(programs):5.0f}"
    )


def _ratios(draws: Sequence[Record]) -> list[float]:
    """Return the medians of chosen, first and last error over that of the best rung."""
    found = [
        [large(one["error"]), large(one["rungs"][0]["error"]), large(one["rungs"][-1]["error"])]
        for one in draws
    ]
    best = [max(best_of(one["rungs"]), 1e-12) for one in draws]
    return [_middle([each[k] / b for each, b in zip(found, best, strict=True)]) for k in range(3)]


def _middle(values: Sequence[float]) -> float:
    return float(np.median(values)) if len(values) else np.nan
