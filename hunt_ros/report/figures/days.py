"""The same rig on several days: how far the limit cycle and the growth rates are apart."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from hunt_ros.report.figures import style
from hunt_ros.report.numbers import rounded
from hunt_ros.report.result import Result
from hunt_ros.report.tables import data, folded, not_known, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hunt_ros.identification.days import Days

_MARKERS = 'osD^v<>Ph*'
_HUES = ('up', 'down', 'stable', 'unstable', 'roughness', 'hold')
#: Days that get a marker of their own; of more, the table tells.
_MOST = 10


def days_apart(days: Days) -> Figure:
    """
    Draw the limit cycle of each day against the mean of the days, and the growth rates.

    Parameters
    ----------
    days : Days
        Of at least two days that share a speed, or that saw free motion.

    Returns
    -------
    Figure
        One page wide.
    """
    with style.journal_style():
        figure = style.new_figure(style.PAGE, 0.4 * style.PAGE)
        left, right = figure.subplots(1, 2)
        looks = cycle(zip(_MARKERS, (style.COLOURS[hue][0] for hue in cycle(_HUES)), strict=False))
        look = {one.day: next(looks) for one in days.summaries[:_MOST]}
        _shifts(left, days, look)
        _rates(right, days, look)
        handles, labels = left.get_legend_handles_labels()
        more, others = right.get_legend_handles_labels()
        named = dict(zip([*labels, *others], [*handles, *more], strict=True))
        if named:
            figure.legend(
                list(named.values()),
                list(named),
                loc='outside upper left',
                ncol=min(len(named), 5),
            )
        return figure


def _shifts(axes: Axes, days: Days, look: Mapping[str, tuple[str, str]]) -> None:
    """Draw how far the amplitudes of each day are from the mean of the days."""
    style.frame(axes, style.SPEED_LABEL, 'Amplitude − mean of the days (mm)')
    branches = days.branches
    shared = np.isfinite(branches.amplitudes).sum(axis=0) >= 2
    if not shared.any():
        _nothing(axes, 'no speed was measured on two days')
        return
    speeds = branches.speeds[shared]
    mean = np.nanmean(branches.amplitudes[:, shared], axis=0)
    spreads = branches.spreads(days.seed)
    half = style.MILLIMETRES * np.array([one.day_std for one in spreads])
    axes.fill_between(speeds, -half, half, color=style.GRID, linewidth=0.0, zorder=0)
    axes.axhline(0.0, color=style.MUTED, linewidth=0.6)
    for day, row in zip(branches.days, branches.amplitudes[:, shared], strict=True):
        if day in look and np.isfinite(row).any():
            marker, colour = look[day]
            axes.plot(
                speeds, style.MILLIMETRES * (row - mean), marker, color=colour,
                markerfacecolor='none', linestyle=(0, (1, 1.5)), linewidth=0.6, label=day,
            )  # fmt: skip


def _rates(axes: Axes, days: Days, look: Mapping[str, tuple[str, str]]) -> None:
    """Draw the growth rates of free motion, each day in its colour."""
    style.frame(axes, style.SPEED_LABEL, 'Growth rate of free motion (1/s)')
    known = [hit for hit in days.hits if math.isfinite(hit.growth_rate) and hit.day in look]
    if not known:
        _nothing(axes, 'no free motion at one speed was seen')
        return
    axes.axhline(0.0, color=style.MUTED, linewidth=0.6)
    for day, (marker, colour) in look.items():
        own = [hit for hit in known if hit.day == day]
        if own:
            axes.errorbar(
                [hit.speed for hit in own], [hit.growth_rate for hit in own],
                yerr=[hit.growth_rate_std for hit in own], fmt=marker, color=colour,
                markerfacecolor='none', elinewidth=0.6, linestyle='none', label=day,
            )  # fmt: skip


def _nothing(axes: Axes, reason: str) -> None:
    axes.text(0.5, 0.5, reason, transform=axes.transAxes, ha='center', va='center')
    axes.set_xticks([])
    axes.set_yticks([])


def days_tables(result: Result) -> str:
    """Return the tables of the days: what each shows, the mean branch, the growth rates."""
    summaries: Sequence[Mapping[str, Any]] = result.get('days.summary') or ()
    std = result.value('days.day_std_m')
    apart = (
        not_known(result, 'days.day_std_m')
        if std is None
        else data('days.day_std_m', std, f'{rounded(1e3 * std, digits=2).html()} mm')
    )
    head = f'<p>Standard deviation of the limit cycle from day to day: {apart}.</p>'
    if len(summaries) < 2:
        return head
    rows = [
        [
            escape(str(entry['day'])),
            str(entry['recordings']),
            _cell(result, f'days.summary.{k}.shift_m', 1e3),
            _cell(result, f'days.summary.{k}.highest_decay_mps'),
            _cell(result, f'days.summary.{k}.lowest_growth_mps'),
            _cell(result, f'days.summary.{k}.observed_v_n'),
            _cell(result, f'days.summary.{k}.observed_v_c'),
        ]
        for k, entry in enumerate(summaries)
    ]
    header = [
        'day', 'recordings', 'limit cycle, from the mean of the days (mm)',
        'free motion decayed up to (m/s)', 'and grew from (m/s)',
        'jump down (m/s)', 'jump up (m/s)',
    ]  # fmt: skip
    body = table(header, rows, 'What each day shows; a dash: nothing of the kind.')
    branch = _spreads(
        result, 'stable_branch', 'amplitude_m', 'm', 1e3,
        'Limit cycle, mean over the days with the interval of a bootstrap over days',
        'amplitude (mm)',
    )  # fmt: skip
    rates = _spreads(
        result, 'growth_rates', 'growth_rate_per_s', 'per_s', 1.0,
        'Growth rate of free motion at one speed, mean over the days', 'growth rate (1/s)',
    )  # fmt: skip
    return head + body + branch + rates


def _cell(result: Result, path: str, scale: float = 1.0) -> str:
    value = result.value(path)
    return '–' if value is None else data(path, value, rounded(scale * value, digits=3).html())


def _spreads(
    result: Result, name: str, key: str, unit: str, scale: float, caption: str, words: str
) -> str:
    """Table of one of the lists of spreads; '' where it is empty."""
    entries: Sequence[Mapping[str, Any]] = result.get(f'days.{name}') or ()
    rows = []
    for k, entry in enumerate(entries):
        low, high = (scale * float(end) for end in entry[f'ci95_{unit}'])
        spread = scale * float(entry[f'day_std_{unit}'])
        shown = rounded(scale * float(entry[key]), spread or None, digits=3).html()
        rows.append(
            [
                f'{float(entry["speed_mps"]):.3f}',
                data(f'days.{name}.{k}.{key}', float(entry[key]), shown),
                f'{low:.3g} … {high:.3g}',
                str(entry['days']),
            ]
        )
    if not rows:
        return ''
    header = ['speed (m/s)', f'{words}, ± from day to day', '95 % interval of the mean', 'days']
    return folded(caption, table(header, rows, f'{caption}.'))
