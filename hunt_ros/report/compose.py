"""
The report put together: what is analysed, what is drawn, and the sections in their order.

What cannot be drawn is left out of the figures; the page says why.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from hunt_ros.report import comparison, tables, words
from hunt_ros.report.alarms import AlarmLoad, alarm_table
from hunt_ros.report.choice import either_side, four_states
from hunt_ros.report.figures import style
from hunt_ros.report.figures.bifurcation import hysteresis_loop, identified_diagram
from hunt_ros.report.figures.overview import run_overview
from hunt_ros.report.figures.response_panels import response_panels
from hunt_ros.report.numbers import shown
from hunt_ros.report.page import Section, figure, render
from hunt_ros.report.response import Response, response_of
from hunt_ros.samples import NANOSECONDS, Record, Unknown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hunt_ros.analysis.steady_state import SteadyState
    from hunt_ros.detection import Event
    from hunt_ros.detection.words.clearance import Clearance
    from hunt_ros.identification.result import Identification

_LETTERS = 'abcd'
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


@dataclass(frozen=True, eq=False)
class Report:
    """
    Everything a report shows.

    Parameters
    ----------
    identification : Identification
        With the records it was identified from.
    events : mapping of str to sequence of Event
        Of the detector, by the source of their record.
    title : str
        Of the page.
    roller_diameter : float, optional
        m; where the angle of the roller was not recorded, to count its revolutions.
    alone : sequence of Identification
        Of each recording by itself, to be set side by side.
    loads : sequence of AlarmLoad
        The alarms of each recording.
    clearances : mapping of str to sequence of Clearance
        Verdicts on the speeds that were held, by the source of their record.
    """

    identification: Identification
    events: Mapping[str, Sequence[Event]] = field(default_factory=dict)
    title: str = 'Hunting motion: bifurcations and normal form'
    roller_diameter: float | None = None
    alone: Sequence[Identification] = ()
    loads: Sequence[AlarmLoad] = ()
    clearances: Mapping[str, Sequence[Clearance]] = field(default_factory=dict)

    @cached_property
    def document(self) -> Mapping[str, Any]:
        """The JSON of the identification, of each recording by itself, and of the alarms."""
        document = self.identification.to_json()
        if self.alone:
            document['compared'] = comparison.to_json(self.alone)
        if self.loads:
            document['alarms'] = [load.to_json() for load in self.loads]
        if self.clearances:
            document['clearances'] = [
                {'recording': source, **one.to_json()}
                for source, held in self.clearances.items()
                for one in held
            ]
        return document

    @cached_property
    def chosen(self) -> dict[str, SteadyState]:
        """The states of Fig. 5, by letter."""
        states = four_states(self.identification.steady_states)
        return dict(zip(_LETTERS, states, strict=False))

    @cached_property
    def responses(self) -> dict[str, Response]:
        """Their analysis."""
        return {letter: self._response(state) for letter, state in self.chosen.items()}

    @cached_property
    def pair(self) -> list[Response]:
        """The analysis of the states either side of v_c, Fig. 7; empty where there are none."""
        one = self.identification
        v_c = one.observed.v_c or (None if one.v_c is None else one.v_c.value)
        return [self._response(state) for state in either_side(one.steady_states, v_c)]

    def drawings(self) -> dict[str, Drawing]:
        """
        Draw every figure that the data carry, in the order of the report.

        Returns
        -------
        dict of str to Drawing
            File name without its ending -> drawing.
        """
        one = self.identification
        marks = {letter: (state.speed, state.amplitude) for letter, state in self.chosen.items()}
        found = self._runs()
        if one.steady_states:
            maxima = any(math.isfinite(state.maxima) for state in one.steady_states)
            found['fig06_hysteresis'] = Drawing(
                hysteresis_loop(one, marks),
                'Fig. 6',
                'Steady-state amplitude of the lateral displacement as measured, speed '
                'increasing and decreasing; bars are standard deviations. Dark: the hunting '
                'component alone, which the normal form speaks of. '
                f'{_MAXIMA if maxima else ""}The critical speeds are read off the jumps, shaded '
                'over half a speed step either side. Letters are the panels of Fig. 5.',
                'Hysteresis loop',
            )
        if one.normal_form is not None:
            found['fig10_bifurcation'] = Drawing(
                identified_diagram(one),
                'Fig. 10',
                'Bifurcation diagram of the identified normal form over the measured points. '
                'Bands hold the branch with 95 % probability, the bars on the axis the critical '
                'speeds.',
                'Bifurcation diagram with bands over the measured points',
                wide=True,
            )
        if self.alone:
            found['compared'] = Drawing(
                comparison.comparison_diagram(self.alone),
                '',
                'Each recording by itself: its steady states and the branches of its own normal '
                'form, stable (solid) and unstable (dashed). A recording without branches has no '
                'form of its own.',
                'Recordings side by side',
                wide=True,
            )
        panels = [('05', letter, response) for letter, response in self.responses.items()]
        panels += [('07', *one) for one in zip('ab', self.pair, strict=False)]
        for number, letter, response in panels:
            unknown = ' '.join(
                f'<span class="unknown">{escape(panel)} not known: {escape(reason)}.</span>'
                for panel, reason in response.unknown.items()
            )
            found[f'fig{number}{letter}_response'] = Drawing(
                response_panels(response, letter),
                f'Fig. {int(number)}{letter}',
                f'{response.speed:.2f} m/s: time history, power spectrum with the hunting and '
                'roughness lines, phase portrait and Poincaré section '
                f'({escape(response.kind)}; {response.cut}). {unknown}',
                f'Response at {response.speed:.2f} m/s',
            )
        return found

    def _runs(self) -> dict[str, Drawing]:
        """Draw recordings against time: of many, those in which the most happens."""
        one = self.identification
        v_n, v_c = (None if x is None else x.value for x in (one.v_n, one.v_c))
        found = {}
        for count, record in enumerate(_eventful(one.records, self.events), start=1):
            own = [envelope for envelope in one.envelopes if envelope.source == record.source]
            amplitude = (np.zeros(0), np.zeros(0))
            if own:
                shift = (own[0].start_ns - record.start_ns) / NANOSECONDS
                amplitude = (own[0].time + shift, own[0].amplitude)
            name = record.source or f'recording {count}'
            found[f'run{count:02d}'] = Drawing(
                run_overview(record, amplitude, self.events.get(record.source, ()), (v_n, v_c)),
                '',
                f'{tables.place(name)}: speed, and amplitude of the hunting component with the '
                'roughness line removed. Marks are events of the detector, dashed lines the '
                'critical speeds of the normal form.',
                f'Speed and hunting amplitude of {name} against time',
                wide=True,
            )
        return found

    def html(self, drawn: Mapping[str, Drawing]) -> str:
        """Return the page with the figures that were drawn."""
        placed = {
            name: figure(
                style.inline_svg(one.figure, name, one.description),
                one.number,
                one.caption,
                one.wide,
            )
            for name, one in drawn.items()
        }
        return render(
            self.title, words.lead(self.identification), self._sections(placed), self.document
        )

    def _response(self, state: SteadyState) -> Response:
        """Analyse the record over a steady state."""
        one = self.identification
        record = next(x for x in one.records if x.source == state.source)
        stretch = record.between(state.start_ns, state.end_ns)
        hunting = math.nan if one.frequency_hz is None else one.frequency_hz.value
        return response_of(stretch, state.speed, hunting, self.roller_diameter)

    def _sections(self, placed: Mapping[str, str]) -> list[Section]:
        one = self.identification

        def pick(start: str, otherwise: str = '') -> str:
            """Return the figures whose names begin so."""
            found = ''.join(text for name, text in placed.items() if name.startswith(start))
            return found or otherwise

        form = words.EQUATION + tables.coefficients(one)
        form += pick('fig10') or _unknown(one.why('coefficients.D4').reason)
        panels = f'<div class="grid">{pick("fig05")}</div>' + tables.responses(self.responses)
        either_side = f'<div class="grid">{pick("fig07")}</div>'
        if not self.pair:
            either_side = _unknown('no settled state on both sides of it, speed up')
        lists = tables.folded('Steady amplitudes', tables.steady_states(one))
        loop = pick('fig06', _unknown('no steady state was found'))
        if not self.responses:
            panels = _unknown('no steady stretch was found')
        sections = [
            ('result', 'Result', tables.critical_speeds(one)),
            ('run', 'The recordings', tables.recordings(one.records) + pick('run')),
            ('alarms', 'Alarms', self.loads and alarm_table(self.loads)),
            ('clearances', 'Clearance', self.clearances and tables.clearances(self.clearances)),
            ('events', 'Events', tables.events(self.events, one.records)),
            ('hysteresis', 'Hysteresis', loop),
            ('normal-form', 'Normal form', form),
            (
                'compared',
                'Side by side',
                self.alone and pick('compared') + comparison.comparison_table(self.alone),
            ),
            ('disturbance', 'Disturbance', words.disturbance(one)),
            ('response', 'Response at four speeds', panels),
            ('poincare', 'Either side of the critical speed', either_side),
            ('fit', 'Fit', tables.fit_quality(one)),
            ('tables', 'Measured amplitudes and stretches', lists),
            ('warnings', 'Warnings', tables.warnings(one)),
            ('unknown', 'What is not known', tables.unknowns(one)),
            ('file', 'Parameter file', _parameter_file(one)),
        ]
        return [(anchor, title, str(body)) for anchor, title, body in sections if body]


def _unknown(reason: str) -> str:
    return f'<p>{shown(Unknown(reason))}</p>'


def _parameter_file(identification: Identification) -> str:
    if identification.normal_form is None:
        return _unknown('no normal form was identified')
    return (
        '<p>What the detector reads (<code>--params-file</code>), with the covariance:</p>'
        f'<pre>{escape(identification.normal_form.to_yaml())}</pre>'
    )


def _eventful(records: Sequence[Record], events: Mapping[str, Sequence[Event]]) -> list[Record]:
    """Return the records to draw, in their order: those with the most events and speeds."""

    def happenings(record: Record) -> tuple[int, float]:
        """Return events and range of speeds of a record."""
        speed = record['speed'].values if 'speed' in record else np.zeros(0)
        known = speed[np.isfinite(speed)]
        return len(events.get(record.source, ())), float(np.ptp(known)) if known.size else 0.0

    order = sorted(range(len(records)), key=lambda k: happenings(records[k]), reverse=True)
    return [records[k] for k in sorted(order[:_RUNS_DRAWN])]
