"""The report put together: what is analysed, what is drawn, and the sections in their order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

from hunt_ros.errors import IdentificationError
from hunt_ros.report import drawings, listings, tables, words
from hunt_ros.report.choice import either_side, four_states
from hunt_ros.report.drawings import Drawing
from hunt_ros.report.figures import own_model, style
from hunt_ros.report.figures.days import days_tables
from hunt_ros.report.figures.frequency import Frequencies, hunting_frequencies
from hunt_ros.report.figures.overview import RunEvent
from hunt_ros.report.figures.own_model import Model, Residual
from hunt_ros.report.page import Section, figure, render
from hunt_ros.report.response import Response, response_of
from hunt_ros.report.result import Result

if TYPE_CHECKING:
    from hunt_ros.analysis.steady_state import SteadyState
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
    events : sequence of RunEvent
        Of all records.
    title : str
        Of the page.
    roller_diameter : float, optional
        m; where the angle of the roller was not recorded, to count its revolutions.
    model : Model, optional
        The user's own, to be shown beside the measurement.
    """

    identification: Identification
    events: Sequence[RunEvent] = ()
    title: str = 'Hunting motion: bifurcations and normal form'
    roller_diameter: float | None = None
    model: Model | None = None

    @cached_property
    def document(self) -> Mapping[str, Any]:
        """The JSON of the identification, and of the residuals of a model."""
        document = self.identification.to_json()
        if self.model is not None:
            document['model'] = own_model.to_json(self.model, self.residuals)
        return document

    @cached_property
    def residuals(self) -> list[Residual]:
        """What was found, less what the model says."""
        found = Result(self.identification.to_json())
        return [] if self.model is None else own_model.residuals(self.model, found)

    @cached_property
    def result(self) -> Result:
        """The same, read by path."""
        return Result(self.document)

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
        v_c = self.result.value('observed.v_c') or self.result.value('v_c')
        states = either_side(self.identification.steady_states, v_c)
        return None if states is None else (self._response(states[0]), self._response(states[1]))

    @cached_property
    def frequencies(self) -> Frequencies | str:
        """Frequency against amplitude, or why it is not known."""
        form = self.identification.normal_form
        if form is None:
            return 'no normal form was identified'
        try:
            return hunting_frequencies(
                self.identification.records,
                self.identification.steady_states,
                form.form.frequency_hz,
                form.form.critical_speed,
                (form.form.length_scale, form.form.time_scale),
            )
        except IdentificationError as error:
            return str(error)

    def drawings(self) -> dict[str, Drawing]:
        """
        Draw every figure that the data carry.

        Returns
        -------
        dict of str to Drawing
            File name without its ending -> drawing, in the order of the report.
        """
        marks = {letter: (state.speed, state.amplitude) for letter, state in self.chosen.items()}
        found = self.frequencies
        return {
            **drawings.run_drawings(self.identification, self.events, self.result),
            **drawings.loop_drawing(self.result, marks),
            **drawings.form_drawings(self.identification.normal_form, self.result),
            **drawings.model_drawing(self.model, self.residuals, self.result),
            **drawings.fold_drawing(self.identification.posterior, self.result),
            **drawings.response_drawings(self.responses),
            **drawings.poincare_drawing(self.pair),
            **drawings.days_drawing(self.identification.days),
            **drawings.frequency_drawing(None if isinstance(found, str) else found),
        }

    def html(self, drawn: Mapping[str, Drawing]) -> str:
        """Return the page with the figures that were drawn."""
        shown = {
            name: figure(
                style.inline_svg(one.figure, name, one.description),
                one.number,
                one.caption,
                one.wide,
            )
            for name, one in drawn.items()
        }
        return render(self.title, words.lead(self.result), self._sections(shown), self.document)

    def _response(self, state: SteadyState) -> Response:
        """Analyse the record over a steady state."""
        record = next(x for x in self.identification.records if x.source == state.source)
        stretch = record.between(state.start_ns, state.end_ns)
        return response_of(stretch, state.speed, self.roller_diameter)

    def _sections(self, shown: Mapping[str, str]) -> list[Section]:
        result, found = self.result, self.frequencies

        def pick(*starts: str) -> str:
            return ''.join(text for name, text in shown.items() if name.startswith(starts))

        law = _unknown(found) if isinstance(found, str) else listings.frequency_law(found.law)
        return [
            Section('result', 'Result', tables.critical_speeds(result)),
            Section(
                'run',
                'The recordings',
                words.recordings(self.identification.records) + pick('run'),
            ),
            Section('events', 'Events', listings.events(self.events)),
            Section(
                'hysteresis',
                'Hysteresis',
                pick('fig06') or _unknown('no steady state was found'),
            ),
            Section(
                'normal-form',
                'Normal form',
                words.EQUATION
                + tables.coefficients(result)
                + (pick('fig09', 'fig10') or _unknown(result.reason('coefficients.D4')))
                + pick('fig03'),
            ),
            *(
                []
                if self.model is None
                else [
                    Section(
                        'model',
                        'Your model',
                        pick('model') + f'<p>{escape(own_model.sentence(self.residuals))}</p>',
                    )
                ]
            ),
            Section(
                'together',
                'What is known together',
                pick('fold') + tables.correlations(result),
            ),
            Section('disturbance', 'Disturbance', words.disturbance(result) + pick('fig11')),
            Section(
                'response',
                'Response at four speeds',
                f'<div class="grid">{pick("fig05")}</div>' + listings.responses(self.responses)
                if self.responses
                else _unknown('no steady stretch was found'),
            ),
            Section(
                'poincare',
                'Either side of the critical speed',
                pick('fig07') or _unknown('no settled state on both sides of it, speed up'),
            ),
            Section('frequency', 'Frequency against amplitude', pick('frequency') + law),
            Section('days', 'From day to day', pick('days') + days_tables(result)),
            Section('fit', 'Fit', tables.fit_quality(result)),
            Section(
                'tables',
                'Measured amplitudes and branches',
                tables.folded('Steady amplitudes', listings.steady_states(result))
                + (
                    tables.folded('Branches', listings.branches(result))
                    if result.branches()
                    else ''
                )
                + tables.folded('Stretches of the recordings', listings.segments(result)),
            ),
            Section('warnings', 'Warnings', words.warnings(result)),
            Section('unknown', 'What is not known', listings.unknowns(result)),
            Section('file', 'Parameter file', _parameter_file(self.identification)),
        ]


def _unknown(reason: str) -> str:
    return f'<p class="unknown">not known: {escape(reason)}</p>'


def _parameter_file(identification: Identification) -> str:
    if identification.normal_form is None:
        return _unknown('no normal form was identified')
    return (
        '<p>What the detector reads (<code>--params-file</code>), with the covariance:</p>'
        f'<pre>{escape(identification.normal_form.to_yaml())}</pre>'
    )
