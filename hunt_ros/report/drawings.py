"""
The figures of the report: which there are, under which name and number, with which words.

What cannot be drawn is left out here; the page says why.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from hunt_ros.report.comparison import comparison_diagram
from hunt_ros.report.figures.bifurcation import (
    hysteresis_loop,
    identified_diagram,
    normal_form_alone,
)
from hunt_ros.report.figures.overview import run_overview
from hunt_ros.report.figures.response_panels import poincare_pair, response_panels
from hunt_ros.report.response import Response
from hunt_ros.samples import NANOSECONDS, Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hunt_ros.detection import Event
    from hunt_ros.identification.result import Identification

_MAXIMA = 'Pale: the mean of the maxima, which the paper plots; roughness and noise are in it. '
#: Recordings whose run is drawn; the table of recordings has all of them.
_RUNS_DRAWN = 4


@dataclass(frozen=True)
class Drawing:
    """
    A figure of the report.

    Parameters
    ----------
    figure : Figure
        What is drawn.
    number : str
        'Fig. 6', as the paper counts; '' for a figure the paper has not.
    caption : str
        HTML.
    description : str
        Plain text, read aloud in place of the picture.
    wide : bool
        Over the whole page.
    """

    figure: Figure
    number: str
    caption: str
    description: str
    wide: bool = False


def drawings(
    one: Identification,
    events: Mapping[str, Sequence[Event]],
    responses: Mapping[str, Response],
    marks: Mapping[str, tuple[float, float]],
    pair: tuple[Response, Response] | None,
    alone: Sequence[Identification],
) -> dict[str, Drawing]:
    """
    Draw every figure that the data carry.

    Parameters
    ----------
    one : Identification
        With its records.
    events : mapping of str to sequence of Event
        By the source of their record.
    responses : mapping of str to Response
        Of the states of Fig. 5, by letter.
    marks : mapping of str to (speed, amplitude)
        Where these states are, m/s and m.
    pair : (Response, Response) or None
        Of the states either side of v_c.
    alone : sequence of Identification
        Of each recording by itself.

    Returns
    -------
    dict of str to Drawing
        File name without its ending -> drawing, in the order of the report.
    """
    found = _runs(one, events)
    if one.steady_states:
        maxima = any(math.isfinite(state.maxima) for state in one.steady_states)
        found['fig06_hysteresis'] = Drawing(
            hysteresis_loop(one, marks),
            'Fig. 6',
            'Steady-state amplitude of the lateral displacement as measured, speed increasing '
            'and decreasing; bars are standard deviations. Dark: the hunting component alone, '
            f'which the normal form speaks of. {_MAXIMA if maxima else ""}The critical speeds '
            'are read off the jumps, shaded over half a speed step either side. Letters are the '
            'panels of Fig. 5.',
            'Hysteresis loop',
        )
    if one.normal_form is not None:
        found['fig09_normal_form'] = Drawing(
            normal_form_alone(one.normal_form.form),
            'Fig. 9',
            'The identified normal form without dimensions: stable (solid) and unstable (dashed) '
            'steady states.',
            'Amplitude r against detuning',
        )
        found['fig10_bifurcation'] = Drawing(
            identified_diagram(one),
            'Fig. 10',
            'Bifurcation diagram of the identified normal form over the measured points. Bands '
            'hold the branch with 95 % probability, the bars on the axis the critical speeds.',
            'Bifurcation diagram with bands over the measured points',
            wide=True,
        )
    if alone:
        found['compared'] = Drawing(
            comparison_diagram(alone),
            '',
            'Each recording by itself: its steady states and the branches of its own normal form,'
            ' stable (solid) and unstable (dashed). A recording without branches has no form of '
            'its own.',
            'Recordings side by side',
            wide=True,
        )
    for letter, response in responses.items():
        unknown = ' '.join(
            f'<span class="unknown">{escape(panel)} not known: {escape(reason)}.</span>'
            for panel, reason in response.unknown.items()
        )
        found[f'fig05{letter}_response'] = Drawing(
            response_panels(response, letter),
            f'Fig. 5{letter}',
            f'{response.speed:.2f} m/s: time history, power spectrum with the hunting and '
            'roughness lines, phase portrait and Poincaré section '
            f'({escape(response.kind)}; {response.cut}). {unknown}',
            f'Response at {response.speed:.2f} m/s',
        )
    if pair is not None:
        below, above = pair
        found['fig07_poincare'] = Drawing(
            poincare_pair(below, above),
            'Fig. 7',
            f'Poincaré maps below ({escape(below.kind)}) and above ({escape(above.kind)}) the '
            f'linear critical speed, speed increasing: {above.cut}, on the scale of the whole '
            'orbit.',
            'Poincaré maps either side of the critical speed',
            wide=True,
        )
    return found


def _runs(one: Identification, events: Mapping[str, Sequence[Event]]) -> dict[str, Drawing]:
    """Draw recordings against time: of many, those in which the most happens."""
    critical = tuple(None if x is None else x.value for x in (one.v_n, one.v_c))
    found = {}
    for count, record in enumerate(_eventful(one.records, events), start=1):
        own = [envelope for envelope in one.envelopes if envelope.source == record.source]
        amplitude = (np.zeros(0), np.zeros(0))
        if own:
            shift = (own[0].start_ns - record.start_ns) / NANOSECONDS
            amplitude = (own[0].time + shift, own[0].amplitude)
        name = record.source or f'recording {count}'
        found[f'run{count:02d}'] = Drawing(
            run_overview(
                record, amplitude, events.get(record.source, ()), (critical[0], critical[1])
            ),
            '',
            f'{escape(name)}: speed, and amplitude of the hunting component with the roughness '
            'line removed. Marks are events of the detector, dashed lines the critical speeds of '
            'the normal form.',
            f'Speed and hunting amplitude of {name} against time',
            wide=True,
        )
    return found


def _eventful(records: Sequence[Record], events: Mapping[str, Sequence[Event]]) -> list[Record]:
    """Return the records to draw, in their order: those with the most events and speeds."""

    def happenings(record: Record) -> tuple[int, float]:
        speed = record['speed'].values if 'speed' in record else np.zeros(0)
        known = speed[np.isfinite(speed)]
        return len(events.get(record.source, ())), float(np.ptp(known)) if known.size else 0.0

    order = sorted(range(len(records)), key=lambda k: happenings(records[k]), reverse=True)
    return [records[k] for k in sorted(order[:_RUNS_DRAWN])]
