"""The run at a glance: speed and hunting amplitude against time, with the events on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hunt_ros.report.figures import style
from hunt_ros.samples import NANOSECONDS, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hunt_ros.detection import Event

#: Events that get a mark in the picture; the table has all of them.
_MARKED = {
    'escaping': 'v',
    'limit_cycle': 's',
    'quiet': 'o',
    'sensor_fault': 'x',
    'input_stale': 'x',
}


def run_overview(
    record: Record,
    amplitude: tuple[NDArray[np.float64], NDArray[np.float64]],
    events: Sequence[Event] = (),
    critical_speeds: tuple[float | None, float | None] = (None, None),
) -> Figure:
    """
    Draw a run against time.

    Parameters
    ----------
    record : Record
        Its speed is shown.
    amplitude : (time, amplitude)
        Of the hunting component: seconds since the first stamp of the record, and m.
    events : sequence of Event
        Of this record.
    critical_speeds : (v_n, v_c)
        Of the identified form, m/s; None where not known.

    Returns
    -------
    Figure
        One page wide.
    """
    with style.journal_style():
        figure = style.new_figure(style.PAGE, 0.44 * style.PAGE)
        above, below = figure.subplots(2, 1, sharex=True)
        speed = record.get('speed')
        if speed is not None and len(speed):
            time = speed.seconds(record.start_ns)
            above.plot(time, speed.values, color=style.INK, linewidth=0.9)
        for value, words in zip(critical_speeds, (r'$v_n$', r'$v_c$'), strict=True):
            if value is not None:
                above.axhline(value, color=style.MUTED, linewidth=0.6, linestyle=(0, (4, 2)))
                above.annotate(
                    words,
                    (1.0, value),
                    xycoords=('axes fraction', 'data'),
                    xytext=(3, 0),
                    textcoords='offset points',
                    va='center',
                )
        time, values = amplitude
        below.plot(time, style.MILLIMETRES * values, color=style.STABLE, linewidth=0.9)
        _mark_events(below, events, record.start_ns)
        style.frame(above, '', r'Speed $v$ (m/s)')
        style.frame(below, 'Time (s)', 'Hunting\namplitude (mm)')
        below.set_xlim(0.0, max((record.end_ns - record.start_ns) / NANOSECONDS, 1e-3))
        top = 1.08 * max(below.get_ylim()[1], 1e-6)
        below.set_ylim(-0.03 * top, top)
        return figure


def _mark_events(axes: Axes, events: Sequence[Event], start_ns: int) -> None:
    """Mark the events at their amplitude; each kind once in the legend."""
    for kind, marker in _MARKED.items():
        chosen = [one for one in events if one.event == kind]
        if chosen:
            axes.plot(
                [(one.stamp_ns - start_ns) / NANOSECONDS for one in chosen],
                style.MILLIMETRES * np.nan_to_num([one.number('amplitude_m') for one in chosen]),
                marker,
                color=style.UNSTABLE,
                markerfacecolor='none',
                clip_on=False,
                label=kind.replace('_', ' '),
            )
    style.legend_above(axes, columns=5)
