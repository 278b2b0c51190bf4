"""The report put together: what is analysed, what is drawn, and the sections in their order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

from hunt_ros.report import comparison, tables, words
from hunt_ros.report.alarms import AlarmLoad, alarm_table
from hunt_ros.report.choice import either_side, four_states
from hunt_ros.report.drawings import Drawing, drawings
from hunt_ros.report.figures import style
from hunt_ros.report.numbers import shown
from hunt_ros.report.page import Section, figure, render
from hunt_ros.report.response import Response, response_of
from hunt_ros.samples import Unknown

if TYPE_CHECKING:
    from hunt_ros.analysis.steady_state import SteadyState
    from hunt_ros.detection import Event
    from hunt_ros.identification.result import Identification

_LETTERS = 'abcd'


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
    """

    identification: Identification
    events: Mapping[str, Sequence[Event]] = field(default_factory=dict)
    title: str = 'Hunting motion: bifurcations and normal form'
    roller_diameter: float | None = None
    alone: Sequence[Identification] = ()
    loads: Sequence[AlarmLoad] = ()

    @cached_property
    def document(self) -> Mapping[str, Any]:
        """The JSON of the identification, of each recording by itself, and of the alarms."""
        document = self.identification.to_json()
        if self.alone:
            document['compared'] = comparison.to_json(self.alone)
        if self.loads:
            document['alarms'] = [load.to_json() for load in self.loads]
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
    def pair(self) -> tuple[Response, Response] | None:
        """The analysis of the states either side of v_c, Fig. 7."""
        one = self.identification
        v_c = one.observed.v_c or (None if one.v_c is None else one.v_c.value)
        states = either_side(one.steady_states, v_c)
        return None if states is None else (self._response(states[0]), self._response(states[1]))

    def drawings(self) -> dict[str, Drawing]:
        """Draw every figure that the data carry, by name, in the order of the report."""
        marks = {letter: (state.speed, state.amplitude) for letter, state in self.chosen.items()}
        return drawings(
            self.identification, self.events, self.responses, marks, self.pair, self.alone
        )

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
        record = next(x for x in self.identification.records if x.source == state.source)
        stretch = record.between(state.start_ns, state.end_ns)
        return response_of(stretch, state.speed, self.roller_diameter)

    def _sections(self, placed: Mapping[str, str]) -> list[Section]:
        one = self.identification

        def pick(start: str, otherwise: str = '') -> str:
            found = ''.join(text for name, text in placed.items() if name.startswith(start))
            return found or otherwise

        form = words.EQUATION + tables.coefficients(one)
        form += pick('fig09') + pick('fig10') or _unknown(one.why('coefficients.D4').reason)
        sections = [
            Section('result', 'Result', tables.critical_speeds(one)),
            Section('run', 'The recordings', tables.recordings(one.records) + pick('run')),
            *([Section('alarms', 'Alarms', alarm_table(self.loads))] if self.loads else []),
            Section('events', 'Events', tables.events(self.events, one.records)),
            Section(
                'hysteresis', 'Hysteresis', pick('fig06', _unknown('no steady state was found'))
            ),
            Section('normal-form', 'Normal form', form),
        ]
        if self.alone:
            body = pick('compared') + comparison.comparison_table(self.alone)
            sections.append(Section('compared', 'Side by side', body))
        panels = f'<div class="grid">{pick("fig05")}</div>' + tables.responses(self.responses)
        lists = tables.folded('Steady amplitudes', tables.steady_states(one))
        if one.branches:
            lists += tables.folded('Branches', tables.branches(one))
        lists += tables.folded('Stretches of the recordings', tables.segments(one))
        return [
            *sections,
            Section('together', 'What is known together', tables.correlations(one)),
            Section('disturbance', 'Disturbance', words.disturbance(one)),
            Section(
                'response',
                'Response at four speeds',
                panels if self.responses else _unknown('no steady stretch was found'),
            ),
            Section(
                'poincare',
                'Either side of the critical speed',
                pick('fig07', _unknown('no settled state on both sides of it, speed up')),
            ),
            Section('fit', 'Fit', tables.fit_quality(one)),
            Section('tables', 'Measured amplitudes and branches', lists),
            Section('warnings', 'Warnings', tables.warnings(one)),
            Section('unknown', 'What is not known', tables.unknowns(one)),
            Section('file', 'Parameter file', _parameter_file(one)),
        ]


def _unknown(reason: str) -> str:
    return f'<p>{shown(Unknown(reason))}</p>'


def _parameter_file(identification: Identification) -> str:
    if identification.normal_form is None:
        return _unknown('no normal form was identified')
    return (
        '<p>What the detector reads (<code>--params-file</code>), with the covariance:</p>'
        f'<pre>{escape(identification.normal_form.to_yaml())}</pre>'
    )
