"""
Runs and days side by side: their critical speeds over the date, their branches in one diagram.

What is compared are the normal forms that rest on the chosen recordings: a form that rests on
several of them is one point and one curve. Nothing is identified here; a recording on which no
form rests is named, with what to do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.embed import json_item
from bokeh.models.annotations import Legend, LegendItem
from bokeh.models.formatters import DatetimeTickFormatter
from bokeh.plotting import figure

from hunt_ros.dashboard.diagram import branches
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.report.figures.style import COLOURS

#: Told apart by colour and by marker; of more the table tells.
_HUES = ('stable', 'up', 'down', 'unstable', 'roughness', 'hold')
_MARKERS = ('circle', 'square', 'diamond', 'triangle', 'inverted_triangle', 'cross')
MOST = len(_HUES)
#: Stamps before this are seconds of a run, not dates (2000-01-01), s.
_FIRST_DATE_S = 946_684_800.0


def compare(rows: Sequence[Mapping[str, Any]], directory: Path, dark: bool) -> dict[str, Any]:
    """
    Compare recordings.

    Parameters
    ----------
    rows : sequence of mapping
        Of the list of the recordings, those that were chosen.
    directory : Path
        Of the recordings.
    dark : bool
        Colours of the night.

    Returns
    -------
    dict
        For JSON. `forms`: for each normal form `label`, `form`, `recordings`, `days`, `v_n` and
        `v_c` as in the list; `without`: names of recordings on which no form rests; `figures`:
        `speeds` and `diagram` as BokehJS takes them; `problem`: one line, or ''.
    """
    forms: dict[str, dict[str, Any]] = {}
    without = []
    for row in sorted(rows, key=lambda each: (each['began_s'] or 0.0, each['name'])):
        if not row['v_c']:
            without.append(row['name'])
            continue
        where = row['v_c']['form']
        one = forms.setdefault(
            where,
            {
                'form': where, 'recordings': [], 'days': [], 'began_s': row['began_s'],
                'v_n': row['v_n'], 'v_c': row['v_c'],
            },
        )  # fmt: skip
        one['recordings'].append(row['name'])
        if (day := _day(row['began_s'])) not in one['days']:
            one['days'].append(day)
    found, problem = [], ''
    for number, one in enumerate(forms.values()):
        one['label'] = chr(ord('A') + number)
        found.append(one)
    if len(found) > MOST:
        problem = f'{len(found)} normal forms: the first {MOST} are drawn'
    figures = {}
    if found:
        figures['speeds'] = json_item(_speeds(found[:MOST], dark))
        try:
            figures['diagram'] = json_item(_diagram(found[:MOST], directory, dark))
        except (OSError, ValueError) as error:
            problem = f'a normal form cannot be read any more: {error}'
    return {'forms': found, 'without': without, 'figures': figures, 'problem': problem}


def _day(began_s: float | None) -> str:
    if began_s is None or began_s < _FIRST_DATE_S:
        return 'undated'
    return f'{datetime.fromtimestamp(began_s, timezone.utc):%Y-%m-%d}'


def _figure(x: str, y: str, dark: bool, **keywords: Any) -> Any:
    ink, muted, grid = (COLOURS[name][dark] for name in ('ink', 'muted', 'grid'))
    plot = figure(
        x_axis_label=x, y_axis_label=y, height=340, sizing_mode='stretch_width',
        toolbar_location=None, tools='', background_fill_color=None, border_fill_color=None,
        outline_line_color=None, output_backend='canvas', **keywords,
    )  # fmt: skip
    plot.axis.axis_label_text_font_style = 'normal'
    plot.axis.axis_label_text_color = plot.axis.major_label_text_color = ink
    plot.axis.axis_line_color = plot.axis.major_tick_line_color = muted
    plot.axis.minor_tick_line_color = None
    plot.grid.grid_line_color = grid
    return plot


def _looks(dark: bool) -> Any:
    return cycle(zip((COLOURS[hue][dark] for hue in _HUES), _MARKERS, strict=True))


def _legend(plot: Any, items: list[LegendItem], dark: bool) -> None:
    legend = Legend(items=items, orientation='horizontal', background_fill_alpha=0.0)
    legend.update(border_line_color=None, label_text_color=COLOURS['ink'][dark], margin=0)
    plot.add_layout(legend, 'above')


def _speeds(forms: Sequence[Mapping[str, Any]], dark: bool) -> Any:
    """Draw v_n (hollow) and v_c (full) with their 95 % intervals over the date."""
    dated = all((one['began_s'] or 0.0) >= _FIRST_DATE_S for one in forms)
    plot = _figure(
        'date of the first recording (UTC)' if dated else 'normal form',
        'critical speed (m/s)',
        dark,
        x_axis_type='datetime' if dated else 'linear',
    )
    if dated:
        days = '%Y-%m-%d'
        plot.xaxis.formatter = DatetimeTickFormatter(
            hours='%m-%d %H:%M', days=days, months=days, years=days
        )
    else:
        plot.xaxis.ticker = list(range(len(forms)))
        plot.xaxis.major_label_overrides = {k: one['label'] for k, one in enumerate(forms)}
    items = []
    for number, (one, (colour, marker)) in enumerate(zip(forms, _looks(dark), strict=False)):
        x = 1000.0 * one['began_s'] if dated else number
        shown = []
        for name in ('v_n', 'v_c'):
            if not (speed := one[name]):
                continue
            if speed['ci95']:
                low, high = speed['ci95']
                plot.segment([x], [low], [x], [high], line_color=colour, line_width=3)
            fill = colour if name == 'v_c' else COLOURS['paper'][dark]
            shown.append(
                plot.scatter(
                    [x], [speed['value']], marker=marker, size=12, line_color=colour,
                    fill_color=fill, line_width=2,
                )
            )  # fmt: skip
        items.append(LegendItem(label=one['label'], renderers=shown[-1:]))
    _legend(plot, items, dark)
    return plot


def _diagram(forms: Sequence[Mapping[str, Any]], directory: Path, dark: bool) -> Any:
    """Draw the branches: stable solid, unstable dashed, each with its 95 % band."""
    plot = _figure('running speed v (m/s)', 'amplitude of y (mm)', dark)
    items = []
    for one, (colour, _) in zip(forms, _looks(dark), strict=False):
        path = directory / one['form']
        text = path.read_text(encoding='utf-8')
        drawn = branches(IdentifiedNormalForm.from_yaml(text, str(path)))
        shown = []
        for name, dash in (('stable', 'solid'), ('unstable', 'dashed')):
            if (band := drawn['bands'].get(name)) is not None:
                plot.varea(*band, fill_color=colour, fill_alpha=0.12)
            v, a = (np.array(each, dtype=float) for each in drawn[name])
            shown.append(plot.line(v, a, line_color=colour, line_width=2.5, line_dash=dash))
        items.append(LegendItem(label=one['label'], renderers=shown[:1]))
    plot.y_range.start = 0.0
    _legend(plot, items, dark)
    return plot
