"""
The report put together: which figures there are, which sections, in which order.

What cannot be drawn is not drawn; in its place stands why.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from hunt_ros.report import style, tables, words
from hunt_ros.report.choice import either_side, four_states
from hunt_ros.report.cubic import cubic_alone
from hunt_ros.report.disturbance import disturbance_from_width
from hunt_ros.report.hysteresis import hysteresis_loop
from hunt_ros.report.normal_form_diagram import diagram, normal_form_alone
from hunt_ros.report.overview import RunEvent, run_overview
from hunt_ros.report.page import Section, figure, render
from hunt_ros.report.response import Response, response_of
from hunt_ros.report.response_panels import poincare_pair, response_panels
from hunt_ros.report.result import Result
from hunt_ros.samples import NANOSECONDS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hunt_ros.analysis.steady_state import SteadyState
    from hunt_ros.identification.result import Identification

#: Recordings whose run is drawn; the table of recordings has all of them.
_RUNS_DRAWN = 6
_LETTERS = 'abcd'


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
    events : sequence of RunEvent
        Of all records.
    title : str
        Of the page.
    """

    identification: Identification
    events: Sequence[RunEvent] = ()
    title: str = 'Hunting motion: bifurcations and normal form'
    document: Mapping[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'document', self.identification.to_json())

    @property
    def result(self) -> Result:
        """The document of the identification."""
        return Result(self.document)

    def drawings(self) -> dict[str, Drawing]:
        """
        Draw every figure that the data carry.

        Returns
        -------
        dict of str to Drawing
            File name without its ending -> drawing, in the order of the report.
        """
        return {
            **self._runs(),
            **self._loop(),
            **self._forms(),
            **self._responses(),
        }

    def figures(self, drawings: Mapping[str, Drawing]) -> dict[str, Figure]:
        """Return the figures by the names of their files."""
        return {name: drawing.figure for name, drawing in drawings.items()}

    def html(self, drawings: Mapping[str, Drawing]) -> str:
        """Return the page."""
        shown = {
            name: figure(
                style.inline_svg(one.figure, name, one.description),
                one.number,
                one.caption,
                one.wide,
            )
            for name, one in drawings.items()
        }
        return render(self.title, words.lead(self.result), self._sections(shown), self.document)

    def _runs(self) -> dict[str, Drawing]:
        """Draw each recording against time."""
        result = self.result
        critical = (result.value('v_n'), result.value('v_c'))
        drawings = {}
        records = self.identification.records[:_RUNS_DRAWN]
        for count, record in enumerate(records, start=1):
            own = [one for one in self.identification.envelopes if one.source == record.source]
            if own:
                shift = (own[0].start_ns - record.start_ns) / NANOSECONDS
                amplitude = (own[0].time + shift, own[0].amplitude)
            else:
                amplitude = (np.zeros(0), np.zeros(0))
            events = [one for one in self.events if one.source == record.source]
            name = escape(record.source or f'recording {count}')
            drawings[f'run{count:02d}'] = Drawing(
                run_overview(record, amplitude, events, critical),
                '',
                f'{name}: speed, and amplitude of the hunting component with the roughness line '
                'removed. Marks are events of the detector, dashed lines the critical speeds of '
                'the normal form.',
                f'Speed and hunting amplitude of {record.source} against time',
                wide=True,
            )
        return drawings

    def _loop(self) -> dict[str, Drawing]:
        """Draw the hysteresis loop, with the letters of Fig. 5 on it."""
        if not self.document.get('steady_states'):
            return {}
        marks = {
            letter: (state.speed, state.amplitude)
            for letter, state in zip(_LETTERS, self._four(), strict=False)
        }
        caption = (
            'Steady-state amplitude of the lateral displacement as measured, speed increasing '
            'and decreasing; bars are standard deviations. The critical speeds are read off the '
            'jumps, shaded over half a speed step either side. Letters are the panels of Fig. 5.'
        )
        loop = hysteresis_loop(self.result, marks)
        return {'fig06_hysteresis': Drawing(loop, 'Fig. 6', caption, 'Hysteresis loop')}

    def _forms(self) -> dict[str, Drawing]:
        """Draw the figures of the normal form, if there is one."""
        identified, result = self.identification.normal_form, self.result
        if identified is None:
            return {}
        form = identified.form
        drawings = {
            'fig03_cubic': Drawing(
                cubic_alone(form, result),
                'Fig. 3',
                'The normal form cut off after its cubic term. No stable limit cycle is on it: '
                'the amplitudes measured need the quintic term.'
                if form.D4 > 0.0
                else 'The normal form cut off after its cubic term.',
                'Bifurcation diagram of the cubic normal form with the measured points',
            ),
            'fig09_normal_form': Drawing(
                normal_form_alone(form),
                'Fig. 9',
                'The identified normal form without dimensions: stable (solid) and unstable '
                '(dashed) steady states.',
                'Amplitude r against detuning',
            ),
            'fig10_bifurcation': Drawing(
                diagram(identified, result),
                'Fig. 10',
                'Bifurcation diagram of the identified normal form over the measured points. '
                'Bands hold the branch with 95 % probability, the bars on the axis the critical '
                'speeds.',
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
                'disturbance, and (b) as measured. Thick arrows: the disturbance that throws the '
                'wheelset over the unstable branch.',
                'Disturbance size from the hysteresis width',
                wide=True,
            )
        return drawings

    def _responses(self) -> dict[str, Drawing]:
        """Draw Fig. 5 at four speeds and Fig. 7 either side of the critical speed."""
        drawings = {}
        for letter, state in zip(_LETTERS, self._four(), strict=False):
            response = self._response(state)
            if response is None:
                continue
            drawings[f'fig05{letter}_response'] = Drawing(
                response_panels(response, letter),
                f'Fig. 5{letter}',
                f'{response.speed:.2f} m/s, speed {_going(state)}: time history, power spectrum '
                'with the hunting and roughness lines, phase portrait, Poincaré section '
                f'({escape(response.kind)}), and the distance of neighbouring orbits with the '
                f'largest Lyapunov exponent. {_not_known(response)}',
                f'Response at {response.speed:.2f} m/s',
            )
        v_c = self.result.value('observed.v_c') or self.result.value('v_c')
        pair = either_side(self.identification.steady_states, v_c)
        if pair is not None:
            below, above = (self._response(state) for state in pair)
            if below is not None and above is not None:
                drawings['fig07_poincare'] = Drawing(
                    poincare_pair(below, above),
                    'Fig. 7',
                    f'Poincaré maps below ({escape(below.kind)}) and above ({escape(above.kind)}) '
                    'the linear critical speed, speed increasing: one point a revolution of the '
                    'roller, on the scale of the whole orbit.',
                    'Poincaré maps either side of the critical speed',
                    wide=True,
                )
        return drawings

    def _four(self) -> list[SteadyState]:
        return four_states(self.identification.steady_states)

    def _response(self, state: SteadyState) -> Response | None:
        """Analyse the record over a steady state; None where it cannot be found or used."""
        for record in self.identification.records:
            if record.source == state.source:
                part = record.between(state.start_ns, state.end_ns)
                return response_of(part, state.speed)
        return None

    def _sections(self, shown: Mapping[str, str]) -> list[Section]:
        result = self.result

        def pick(*starts: str) -> str:
            return ''.join(text for name, text in shown.items() if name.startswith(starts))

        no_form = f'<p class="unknown">not known: {escape(result.reason("coefficients"))}</p>'
        forms = pick('fig09', 'fig10') or no_form
        responses = pick('fig05')
        return [
            Section('result', 'Result', tables.critical_speeds(result)),
            Section('run', 'The recordings', _recordings(self.identification) + pick('run')),
            Section('events', 'Events', tables.events(self.events)),
            Section(
                'hysteresis',
                'Hysteresis',
                pick('fig06') or '<p>No steady state was found.</p>',
            ),
            Section(
                'normal-form',
                'Normal form',
                words.EQUATION + tables.coefficients(result) + forms + pick('fig03'),
            ),
            Section(
                'disturbance',
                'Disturbance',
                f'<p>From the width of the hysteresis (Appendix A): '
                f'{tables.number(result, "disturbance_m", 1e3)}'
                f'{" mm" if result.get("disturbance_m") else ""}</p>' + pick('fig11'),
            ),
            Section(
                'response',
                'Response at four speeds',
                f'<div class="grid">{responses}</div>'
                if responses
                else '<p class="unknown">not known: no steady stretch was long enough</p>',
            ),
            Section(
                'poincare',
                'Either side of the critical speed',
                pick('fig07')
                or '<p class="unknown">not known: no steady state on both sides of it</p>',
            ),
            Section('fit', 'Fit', tables.fit_quality(result)),
            Section(
                'tables',
                'Measured amplitudes and branches',
                tables.folded('Steady amplitudes', tables.steady_states(result))
                + tables.folded('Branches', tables.branches(result))
                + tables.folded('Stretches of the recordings', tables.segments(result)),
            ),
            Section('warnings', 'Warnings', words.warnings(result)),
            Section('unknown', 'What is not known', tables.unknowns(result)),
            Section('file', 'Parameter file', _parameter_file(self.identification)),
        ]


def _going(state: SteadyState) -> str:
    return {'up': 'increasing', 'down': 'decreasing'}.get(state.direction, 'held')


def _not_known(response: Response) -> str:
    """Say which panels are not known, and why, as HTML."""
    return ' '.join(
        f'<span class="unknown">{escape(panel)} not known: {escape(reason)}.</span>'
        for panel, reason in response.unknown.items()
    )


def _recordings(identification: Identification) -> str:
    header = ['recording', 'start', 'length (s)', 'channels', 'notes']
    rows = [words.recording(record) for record in identification.records]
    return tables.table(header, rows, 'What was read.')


def _parameter_file(identification: Identification) -> str:
    if identification.normal_form is None:
        return '<p class="unknown">not known: no normal form was identified</p>'
    return (
        '<p>What the detector reads (<code>--params-file</code>), with the covariance:</p>'
        f'<pre>{escape(identification.normal_form.to_yaml())}</pre>'
    )
