"""
The figures of the report: which there are, under which name and number, with which words.

What cannot be drawn is left out here; the page says why.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from hunt_ros.report.figures.cubic import cubic_alone
from hunt_ros.report.figures.days import days_apart
from hunt_ros.report.figures.disturbance import disturbance_from_width
from hunt_ros.report.figures.fold_region import fold_region
from hunt_ros.report.figures.frequency import Frequencies, frequency_diagram
from hunt_ros.report.figures.hysteresis import has_maxima, hysteresis_loop
from hunt_ros.report.figures.normal_form_diagram import diagram, normal_form_alone
from hunt_ros.report.figures.overview import RunEvent, run_overview
from hunt_ros.report.figures.own_model import Model, Residual, model_diagram
from hunt_ros.report.figures.response_panels import poincare_pair, response_panels
from hunt_ros.report.response import Response
from hunt_ros.report.result import Result
from hunt_ros.samples import NANOSECONDS, Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.identification.days import Days
    from hunt_ros.identification.posterior import Posterior
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


def run_drawings(
    identification: Identification, events: Sequence[RunEvent], result: Result
) -> dict[str, Drawing]:
    """Draw recordings against time: of many, those in which the most happens."""
    critical = (result.value('v_n'), result.value('v_c'))
    drawings = {}
    for count, record in enumerate(_eventful(identification.records, events), start=1):
        own = [one for one in identification.envelopes if one.source == record.source]
        amplitude = (np.zeros(0), np.zeros(0))
        if own:
            shift = (own[0].start_ns - record.start_ns) / NANOSECONDS
            amplitude = (own[0].time + shift, own[0].amplitude)
        name = record.source or f'recording {count}'
        drawings[f'run{count:02d}'] = Drawing(
            run_overview(
                record,
                amplitude,
                [one for one in events if one.source == record.source],
                critical,
            ),
            '',
            f'{escape(name)}: speed, and amplitude of the hunting component with the roughness '
            'line removed. Marks are events of the detector, dashed lines the critical speeds of '
            'the normal form.',
            f'Speed and hunting amplitude of {name} against time',
            wide=True,
        )
    return drawings


def _eventful(records: Sequence[Record], events: Sequence[RunEvent]) -> list[Record]:
    """Return the records to draw, in their order: those with the most events and speeds."""

    def happenings(record: Record) -> tuple[int, float]:
        speed = record['speed'].values if 'speed' in record else np.zeros(0)
        known = speed[np.isfinite(speed)]
        return (
            sum(one.source == record.source for one in events),
            float(np.ptp(known)) if known.size else 0.0,
        )

    order = sorted(range(len(records)), key=lambda k: happenings(records[k]), reverse=True)
    return [records[k] for k in sorted(order[:_RUNS_DRAWN])]


def loop_drawing(result: Result, marks: Mapping[str, tuple[float, float]]) -> dict[str, Drawing]:
    """Draw the hysteresis loop, with the letters of Fig. 5 on it; nothing without states."""
    if not result.steady_states():
        return {}
    caption = (
        'Steady-state amplitude of the lateral displacement as measured, speed increasing '
        'and decreasing; bars are standard deviations. Dark: the hunting component alone, which '
        f'the normal form speaks of. {_MAXIMA if has_maxima(result) else ""}The critical speeds '
        'are read off the jumps, shaded over half a speed step either side. Letters are the '
        'panels of Fig. 5.'
    )
    loop = hysteresis_loop(result, marks)
    return {'fig06_hysteresis': Drawing(loop, 'Fig. 6', caption, 'Hysteresis loop')}


def form_drawings(identified: IdentifiedNormalForm | None, result: Result) -> dict[str, Drawing]:
    """Draw Figs. 3, 9, 10 and 11; nothing without a normal form, no Fig. 11 without a fold."""
    if identified is None:
        return {}
    form = identified.form
    lesson = (
        ' No stable limit cycle is on it: the amplitudes measured need the quintic term.'
        if form.D4 > 0.0
        else ''
    )
    drawings = {
        'fig03_cubic': Drawing(
            cubic_alone(form, result),
            'Fig. 3',
            f'The normal form cut off after its cubic term.{lesson}',
            'Bifurcation diagram of the cubic normal form with the measured points',
        ),
        'fig09_normal_form': Drawing(
            normal_form_alone(form),
            'Fig. 9',
            'The identified normal form without dimensions: stable (solid) and unstable (dashed) '
            'steady states.',
            'Amplitude r against detuning',
        ),
        'fig10_bifurcation': Drawing(
            diagram(identified, result),
            'Fig. 10',
            'Bifurcation diagram of the identified normal form over the measured points. Bands '
            'hold the branch with 95 % probability, the bars on the axis the critical speeds.',
            'Bifurcation diagram with bands over the measured points',
            wide=True,
        ),
    }
    if form.saddle_node() is not None:
        observed = (result.value('observed.v_n'), result.value('observed.v_c'))
        drawings['fig11_disturbance'] = Drawing(
            disturbance_from_width(form, observed, result.value('disturbance_m')),
            'Fig. 11',
            'Hysteresis width (a) of the normal form, which is that of an infinitely small '
            'disturbance, and (b) as measured. Thick arrows: from the state that was left to the '
            'unstable branch, where the measured jump lies inside the hysteresis of the form.',
            'Disturbance size from the hysteresis width',
            wide=True,
        )
    return drawings


def fold_drawing(posterior: Posterior | None, result: Result) -> dict[str, Drawing]:
    """Draw what is known of the fold; nothing where none is known."""
    if posterior is None or result.value('fold_amplitude_m') is None:
        return {}
    caption = (
        'Where the two limit cycles meet: each point is one form that the data allow. The '
        'ellipses hold 68 % and 95 % of them.'
    )
    figure = fold_region(posterior)
    return {'fold': Drawing(figure, '', caption, 'Joint region of v_n and the amplitude there')}


def model_drawing(
    model: Model | None, residuals: Sequence[Residual], result: Result
) -> dict[str, Drawing]:
    """Draw the user's own model; nothing without one."""
    if model is None:
        return {}
    caption = (
        f'{escape(model.label)}: its branches (lines) over the measured states and the identified'
        ' bands, and what was found less what it says, in standard deviations; shaded: two.'
    )
    figure = model_diagram(model, residuals, result)
    return {'model': Drawing(figure, '', caption, 'Own model beside the measurement', wide=True)}


def response_drawings(responses: Mapping[str, Response]) -> dict[str, Drawing]:
    """Draw the panels of Fig. 5, by letter."""
    return {
        f'fig05{letter}_response': Drawing(
            response_panels(response, letter),
            f'Fig. 5{letter}',
            f'{response.speed:.2f} m/s: time history, power spectrum with the hunting and '
            'roughness lines, phase portrait, Poincaré section '
            f'({escape(response.kind)}; {response.cut}), and the distance of neighbouring '
            f'orbits with the largest Lyapunov exponent. {_not_known(response)}',
            f'Response at {response.speed:.2f} m/s',
        )
        for letter, response in responses.items()
    }


def poincare_drawing(pair: tuple[Response, Response] | None) -> dict[str, Drawing]:
    """Draw Fig. 7; nothing without a state on both sides of v_c."""
    if pair is None:
        return {}
    below, above = pair
    caption = (
        f'Poincaré maps below ({escape(below.kind)}) and above ({escape(above.kind)}) the linear '
        f'critical speed, speed increasing: {above.cut}, on the scale of the whole orbit.'
    )
    figure = poincare_pair(below, above)
    description = 'Poincaré maps either side of the critical speed'
    return {'fig07_poincare': Drawing(figure, 'Fig. 7', caption, description, wide=True)}


def days_drawing(days: Days | None) -> dict[str, Drawing]:
    """Draw the days side by side; nothing of a single day."""
    if days is None or len(days.summaries) < 2:
        return {}
    caption = (
        'The rig on different days. Left: limit cycle of each day against the mean of the days, '
        'with their standard deviation shaded. Right: growth rate of free motion while it was '
        'small; bars are standard deviations.'
    )
    figure = days_apart(days)
    return {'days': Drawing(figure, '', caption, 'The days side by side', wide=True)}


def frequency_drawing(found: Frequencies | None) -> dict[str, Drawing]:
    """Draw frequency against amplitude; nothing where it could not be measured."""
    if found is None:
        return {}
    caption = (
        'Hunting frequency of the steady states against their amplitude. Neighbouring points are '
        'at different speeds, for which the law of Eq. (25) accounts.'
    )
    figure = frequency_diagram(found)
    return {'frequency': Drawing(figure, '', caption, 'Hunting frequency against amplitude')}


def _not_known(response: Response) -> str:
    """Say which panels are not known, and why, as HTML."""
    return ' '.join(
        f'<span class="unknown">{escape(panel)} not known: {escape(reason)}.</span>'
        for panel, reason in response.unknown.items()
    )
