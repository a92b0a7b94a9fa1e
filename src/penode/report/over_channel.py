"""The one-step residual along the value of a channel: speed, angle, or an input of any model."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from penode.report import palette, panels
from penode.report.quantities import labelled, number, scale_for, symbol
from penode.report.statements import listed
from penode.validation.residual_tests import Correlations, OverChannel

#: Deviations of a mean that none of some hundred stretches has by chance.
_BY_CHANCE = 4.0
_HEIGHT, _BETWEEN, _LABELS, _GAP = 150.0, 30.0, 46.0, 0.12


def over_channel_title(shown: Sequence[OverChannel]) -> str:
    """Say how much of the residual goes with the channels, as far as that is no chance."""
    shares, texts = {}, []
    for one in shown:
        rms = np.sqrt(np.nanmean(one.rms**2, axis=0))
        share = np.abs(one.mean) / np.maximum(rms, 1e-300)
        shares[one.channel] = f"{number(100 * float(np.nanmax(share)), 2)} % along {one.channel}"
        limit = _BY_CHANCE * one.chance[:, None] if len(one.chance) else 0.0
        if np.nanmax(share - limit) > 0:
            texts.append(shares[one.channel])
    if not texts:
        most = listed([*shares.values()])
        return f"The mean of the residual is nowhere beyond chance (of its rms at most {most})"
    return f"Mean of the residual as a share of its rms: at most {listed(texts)}"


def over_channel(
    tests: Correlations, shown: Sequence[OverChannel], units: Mapping[str, str]
) -> go.Figure:
    """Draw mean and rms of the residual along each channel, a row per state and a column a channel.

    ``units`` are those of predicted states and channels, as far as they are known.
    """
    rows, columns = len(tests.states), len(shown)
    heights = [_HEIGHT] * rows
    wide = panels.Grid([1.0] * columns, heights, _GAP, [_BETWEEN] * (rows - 1))
    gaps = ([_BETWEEN] * (rows - 1) + [_BETWEEN + _LABELS]) * columns
    pile = panels.Grid([1.0], heights * columns, gaps=gaps[:-1])
    order = [row * columns + column for column in range(columns) for row in range(rows)]
    figure = panels.panelled(wide, pile, order)
    for column, one in enumerate(shown):
        for row, state in enumerate(tests.states):
            place = {"row": row + 1, "col": column + 1}
            known = np.isfinite(one.mean[:, row])
            scale = scale_for(
                [float(np.nanmax(each.rms[:, row])) for each in shown], units.get(state, "")
            )
            at, mean, rms = one.value[known], one.mean[known, row], one.rms[known, row]
            mean, rms = mean * scale.factor, rms * scale.factor
            figure.add_scatter(
                x=np.concatenate([at, at[::-1]]),
                y=np.concatenate([rms, -rms[::-1]]),
                line={"width": 0},
                fill="toself",
                fillcolor=palette.INTERVAL.light,
                name="± rms",
                legendgroup="rms",
                showlegend=not row and not column,
                hoverinfo="skip",
                **place,
            )
            figure.add_scatter(
                x=at,
                y=mean,
                mode="lines+markers",
                line={"color": palette.ONE_STEP.light, "width": 1.6},
                marker={"size": 4},
                name="mean",
                legendgroup="mean",
                showlegend=not row and not column,
                hovertemplate="%{x:.4~g}: %{y:.3~g}",
                **place,
            )
            title = None if column else labelled(symbol(state), scale.unit)
            figure.update_yaxes(nticks=5, title_text=title, **place)
        title = labelled(symbol(one.channel), units.get(one.channel, ""))
        figure.update_xaxes(title_text=title, row=rows, col=column + 1)
    return figure.update_layout(margin={"t": 44})
