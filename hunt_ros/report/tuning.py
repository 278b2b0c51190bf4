"""
Settings of the detector over recordings: false alarms an hour against the delay of the alarm.

True is what the whole recording shows afterwards (`identification.record.events`): hunting is
growth out of rest, motion that stayed, and its dying while the speed falls; harmless is rest at
one speed, and a kick that died. What is neither is undecided: an alarm there counts for nothing.
A delay counts from the instant at which the envelope left the rest, known to one of its windows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from hunt_ros.detection import DetectorConfig
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.identification import Identification
from hunt_ros.identification.executors import Tell, mapper
from hunt_ros.identification.record.events import Event
from hunt_ros.report.alarms import load_of, rate_per_hour
from hunt_ros.report.events import events_of
from hunt_ros.report.figures import style
from hunt_ros.samples import NANOSECONDS, Record, Uncertain, known

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Spans = Sequence[tuple[float, float]]
#: Of the smallest limit cycle that was seen, for a limit of the amplitude.
_OF_CYCLE = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class Truth:
    """Where a recording hunted, and where an alarm was false: s since its start, in order."""

    hunting: Spans
    harmless: Spans
    duration_s: float

    @classmethod
    def of(cls, record: Record, events: Iterable[Event]) -> Truth:
        """Return it from the events of all recordings."""
        hunting: list[tuple[float, float]] = []
        harmless: list[tuple[float, float]] = []
        goes_on = False
        own = (event for event in events if event.source == record.source)
        for event in sorted(own, key=lambda event: event.start_ns):
            begin, end = (
                (ns - record.start_ns) / NANOSECONDS for ns in (event.start_ns, event.end_ns)
            )
            if event.kind == 'rest' or (event.kind == 'died' and math.isfinite(event.kick)):
                harmless.append((begin, end))
                goes_on = False
            elif goes_on:
                hunting[-1] = hunting[-1][0], max(end, hunting[-1][1])
            elif event.kind != 'died':
                hunting.append((begin, end))
                goes_on = True
        return cls(hunting, harmless, record.duration_s)

    @property
    def harmless_s(self) -> float:
        """How long an alarm would have been false."""
        return sum(end - begin for begin, end in self.harmless)


@dataclass(frozen=True)
class Outcome:
    """
    What a setting does over all recordings.

    Parameters
    ----------
    setting : str
        '' for the settings as they are.
    value : float
    false_alarms, missed, undecided : int
        Alarms that were false; hunting without one; alarms where nothing is decided.
    harmless_s : float
    delays_s : sequence of float
        Of each hunting that had an alarm; 0 where it was on before.
    """

    setting: str
    value: float
    false_alarms: int
    harmless_s: float
    delays_s: Sequence[float]
    missed: int
    undecided: int

    @property
    def per_hour(self) -> Uncertain:
        """False alarms an hour, with the exact interval of a count."""
        return rate_per_hour(self.false_alarms, self.harmless_s)

    @property
    def delay_s(self) -> tuple[float, float, float]:
        """Median, least and longest delay, s; NaN without any."""
        x = self.delays_s or [math.nan]
        return float(np.median(x)), min(x), max(x)

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        told = {item.name: getattr(self, item.name) for item in fields(self)}
        median, least, longest = map(known, self.delay_s)
        delay = {'median_s': median, 'least_s': least, 'longest_s': longest}
        told |= {'value': known(self.value), 'setting': self.setting or None}
        return told | {'false_alarms_per_hour': self.per_hour.to_json(), 'delay': delay}

    def differs(self, other: Outcome) -> bool:
        """Whether the two rates differ by more than chance: the intervals do not overlap."""
        one, two = self.per_hour, other.per_hour
        return one.low > two.high or two.low > one.high


def usual_grid(identification: Identification, form: bool) -> dict[str, tuple[float, ...]]:
    """
    Return the settings that shift an alarm, and values of each.

    The delay of a sequential test rises with the logarithm of the time between its false alarms
    (Lorden, 1971), hence decades; a limit of the amplitude lies below the smallest limit cycle.
    """
    grid: dict[str, tuple[float, ...]] = {
        'false_alarms_per_week': (1e-3, 1.0, 1e3, 1e5),
        'least_damping_per_s': (0.02, 0.05, 0.15),
    }
    if form:
        grid['escape_probability_in'] = (0.8, 0.95, 0.99)
    stayed = [event.amplitude for event in identification.bracket.events if event.kind == 'stayed']
    if stayed:
        limits = (float(f'{1e3 * part * min(stayed):.2g}') for part in _OF_CYCLE)
        grid['alarm_lateral_mm'] = (0.0, *limits)
    return grid


def tune(
    identification: Identification,
    config: DetectorConfig,
    form: IdentifiedNormalForm | None,
    grid: Mapping[str, Sequence[float]],
    cluster: str = '',
    tell: Tell | None = None,
) -> tuple[list[Truth], list[Outcome]]:
    """
    Replay the detector over the recordings as it is set, and with one setting changed at a time.

    Parameters
    ----------
    identification : Identification
        Of the recordings, with their records.
    config : DetectorConfig
        The settings as they are.
    form : IdentifiedNormalForm or None
        The form in force.
    grid : mapping of str to sequence of float
        Name of a setting -> its values.
    cluster : str
        See `mapper`.
    tell : callable, optional
        Told which share is done.

    Returns
    -------
    list of Truth
        Of each record.
    list of Outcome
        Of the settings as they are, and of each value of the grid.

    Raises
    ------
    ConfigError
        For a value out of the range of its setting.
    """
    others = [(name, x) for name, several in grid.items() for x in several]
    asked = [('', math.nan), *((name, x) for name, x in others if x != getattr(config, name))]
    changes: list[dict[str, Any]] = [{name: x} if name else {} for name, x in asked]
    configs = [replace(config, **change) for change in changes]
    records = identification.records
    truths = [Truth.of(record, identification.bracket.events) for record in records]
    pairs = list(product(configs, records))
    with mapper(cluster) as mapped:
        spells = []
        for spell in mapped(partial(_spells, form), *zip(*pairs, strict=True)):
            spells.append(spell)
            if tell:
                tell(len(spells) / len(pairs))
    rows = [spells[k : k + len(records)] for k in range(0, len(spells), len(records))]
    return truths, [outcome_of(*one, truths, row) for one, row in zip(asked, rows, strict=True)]


def _spells(form: IdentifiedNormalForm | None, config: DetectorConfig, record: Record) -> Spans:
    """Return when an alarm of the motion was on, s since the start, whatever its code."""
    events, _ = events_of(record, form, config)
    alarms = load_of(events, record, False).alarms
    own = (code for code in alarms if code == 'hunting' or code.startswith('alarm_'))
    joined: list[tuple[float, float]] = []
    for begin, end in sorted(spell for code in own for spell in alarms[code]):
        if joined and begin <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(end, joined[-1][1])
        else:
            joined.append((begin, end))
    return joined


def outcome_of(
    setting: str, value: float, truths: Sequence[Truth], row: Sequence[Spans]
) -> Outcome:
    """
    Judge the alarms of each record by where they began.

    Parameters
    ----------
    setting, value
        What was changed.
    truths : sequence of Truth
        Of each record.
    row : sequence of Spans
        When an alarm was on in each record, s since its start.

    Returns
    -------
    Outcome
    """
    delays: list[float] = []
    false = missed = undecided = 0
    for truth, spells in zip(truths, row, strict=True):
        for begin, end in truth.hunting:
            first = next((on for on, off in spells if on <= end and off >= begin), None)
            missed += first is None
            if first is not None:
                delays.append(max(0.0, first - begin))
        for on, _ in spells:
            inside = [any(a <= on <= b for a, b in s) for s in (truth.harmless, truth.hunting)]
            false += inside[0]
            undecided += not any(inside)
    seconds = sum(truth.harmless_s for truth in truths)
    return Outcome(setting, value, false, seconds, delays, missed, undecided)


def picture(outcomes: Sequence[Outcome]) -> Figure:
    """Draw false alarms an hour against the delay: a line a setting, with the intervals."""
    with style.journal_style():
        figure = style.new_figure(style.PAGE, 0.5 * style.PAGE)
        axes = figure.add_subplot()
        style.frame(axes, 'delay of the alarm, median and range (s)', 'false alarms an hour')
        hours = max(outcomes[0].harmless_s / 3600.0, 1e-9)
        axes.set_yscale('symlog', linthresh=1.0 / hours)
        names = list(dict.fromkeys(one.setting for one in outcomes))
        colours = list(style.COLOURS.values())[4:]
        for number, name in enumerate(names):
            colour, mark = colours[number % len(colours)][0], 'D^osv<>p'[number % 8]
            own = [one for one in outcomes if one.setting == name and one.delays_s]
            if not own:
                continue
            x, y = np.array([o.delay_s for o in own]), [o.per_hour for o in own]
            axes.errorbar(
                x[:, 0], [rate.value for rate in y],
                [[r.value - r.low for r in y], [r.high - r.value for r in y]],
                [x[:, 0] - x[:, 1], x[:, 2] - x[:, 0]],
                marker=mark, color=colour, ecolor=colour, elinewidth=0.4, capsize=1.5,
                linestyle='none', label=name or 'as they are',
            )  # fmt: skip
            for at, one in zip(x[:, 0], own, strict=True):
                if name:
                    axes.annotate(f'{one.value:g}', (at, one.per_hour.value), fontsize=6,
                                  xytext=(3, 3), textcoords='offset points')  # fmt: skip
        style.legend_above(axes, 3)
    return figure
