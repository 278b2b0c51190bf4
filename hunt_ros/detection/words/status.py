"""What the detector says: events, where something changed from row to row, and its view now."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.decision.limits import LIMITS, limit_cause
from hunt_ros.detection.door import Door
from hunt_ros.detection.output import (
    PUBLIC,
    Event,
    blank_rows,
    joined_rows,
    no_row,
    numbers_behind,
    seconds_text,
)
from hunt_ros.detection.regions import Level, Region, State
from hunt_ros.detection.slow import CONTRADICTED_S, TOLERANCE_MPS
from hunt_ros.detection.words.alarms import AlarmHistory
from hunt_ros.detection.words.reasons import (
    Basis,
    absent_words,
    causes_of,
    margin_cause,
    outside_words,
    reasons_of,
    region_cause,
    state_cause,
)
from hunt_ros.samples import CHANNELS, CLOCK_OFFSET_NS, NANOSECONDS

#: What makes an event: word, test, cause, and since when, ns.
_Change = tuple[str, str, str, int]

#: A disturbance that stays in the basin is a state, not an event.
_STATES = {State.ESCAPING, State.LIMIT_CYCLE, State.DECAYING}
_REGIONS = {Region.HYSTERESIS: 'hysteresis', Region.UNSTABLE: 'unstable'}


@dataclass(frozen=True)
class DetectorStatus:
    """
    The detector's present view.

    Parameters
    ----------
    stamp_ns : int
        Row it was taken at; 0 before the first.
    level : Level
    region : Region
    state : State
    alarm : bool
        Latched: hunting was seen and has not been acknowledged.
    reasons : tuple of str
        Why the level is what it is: one short sentence each, empty when OK.
    absent : tuple of str
        Optional channels that are absent, and what that costs: no reason for a level.
    dropped : mapping of str to int
        Refused samples, 'channel reason' to count.
    clock_offsets_s : mapping of str to float
        Channel and by how much the detector's clock is ahead of its clock, transport delay
        included, s; without those not known.
    values : mapping of str to object
        All of it as it is published in `hunting/status`, with the unit in the key; NaN and ''
        where unknown.
    """

    stamp_ns: int
    level: Level
    region: Region
    state: State
    alarm: bool
    reasons: tuple[str, ...]
    absent: tuple[str, ...]
    dropped: Mapping[str, int]
    clock_offsets_s: Mapping[str, float]
    values: Mapping[str, object]

    def number(self, key: str) -> float:
        """Return one of the values that are numbers, e.g. 'amplitude_m'; NaN: unknown."""
        value = self.values[key]
        return float(value) if isinstance(value, (int, float)) else math.nan


class Transitions:
    """
    Remembers the last row, and names what changed since.

    Parameters
    ----------
    basis : Basis
        Names the channels, and the limits that the causes speak of.

    Attributes
    ----------
    basis : Basis
    decided : str
        Why the hunting that is in force was said; '' where there is none.
    decided_ns, level_since_ns : int
        Rows at which the state was decided, and from which on the level is in force; 0 before any.
    test : str
        Which test decided the state; '' before any.
    """

    def __init__(self, basis: Basis) -> None:
        self.basis = basis
        self._channels = tuple(name for name in CHANNELS if name in basis.config.channels)
        self._last = blank_rows(np.zeros(1, dtype=np.int64))
        self._last['level'] = -1
        #: When what lasts began.
        self._began_ns: dict[str, int] = {}
        self.decided, self.test = '', ''
        self.decided_ns = self.level_since_ns = 0

    def update(self, rows: NDArray[np.void]) -> list[Event]:
        """
        Return the events of new rows, in their order.

        Parameters
        ----------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            With level, region and state filled in; m > 0.
        """
        rows = joined_rows([self._last, rows])
        self._last = rows[-1:].copy()
        changed = back = np.diff(rows['stamp_ns']) < 0
        bits = {f'{name}_wrong': health.MISSING | health.FAULTS for name in self._channels}
        bits |= {'doubts': doubts.MARGIN | doubts.OUTSIDE}
        watched = [rows[name] for name in ('region', 'state', 'level', 'limits')]
        watched += [rows[name] & np.uint32(mask) for name, mask in bits.items()]
        for column in watched:
            changed = changed | (column[1:] != column[:-1])
        events = []
        for k in np.flatnonzero(changed).tolist():
            before, row = rows[k], rows[k + 1]
            if back[k]:  # the clocks were set: nobody knows how long ago it was
                self._began_ns.clear()
            if row['level'] != before['level']:
                self.level_since_ns = int(row['stamp_ns'])
            events += [self.event_of(row, *change) for change in self._changes(before, row)]
        return events

    @property
    def row(self) -> np.void:
        """The last row."""
        row: np.void = self._last[0]
        return row

    def event_of(
        self, row: np.void, word: str, test: str, cause: str, since_ns: int | None = None
    ) -> Event:
        """
        Return the event of a word at a row.

        Where the level is WARN or STALE for more than the cause of the event, the cause says
        that too. `since_ns` None: it began with the row.
        """
        stamp_ns, level = int(row['stamp_ns']), Level(int(row['level']))
        reasons = self.reasons(row)
        if level in (Level.WARN, Level.STALE) and reasons:
            told = reasons[0]
            if told not in cause and cause not in told:
                cause += f'; {level.label}: {told}'
        since_ns = stamp_ns if since_ns is None else since_ns
        form, numbers = self.basis.normal_form, numbers_behind(row)
        return Event(stamp_ns, word, level, since_ns, test, cause, form, numbers)

    def reasons(self, row: np.void) -> tuple[str, ...]:
        """Return why the level of a row is what it is, the most serious first."""
        return reasons_of(row, self.basis._replace(decided=self.decided))

    def _changes(self, before: np.void, row: np.void) -> Iterator[_Change]:
        """Yield what has changed since the row before."""
        for name in self._channels:
            yield from self._channel(name, int(before[f'{name}_wrong']), row)
        old, new = Region(int(before['region'])), Region(int(row['region']))
        if new != old:
            cause, since_ns = region_cause(row, self.basis), int(row['region_since_ns'])
            for region, word in ((old, 'left'), (new, 'entered')):
                if region in _REGIONS:
                    yield f'{_REGIONS[region]}_{word}', 'speed', cause, since_ns
        low = int(row['doubts']) & doubts.MARGIN
        if low != int(before['doubts']) & doubts.MARGIN:
            word = 'margin_low' if low else 'margin_restored'
            yield word, 'margin', margin_cause(row, self.basis), int(row['margin_since_ns'])
        for number, limit in enumerate(LIMITS):
            over, was = (int(x['limits']) & (1 << number) for x in (row, before))
            if over != was:
                word = 'limit_exceeded' if over else 'limit_cleared'
                cause = limit_cause(row, number, self.basis.config)
                yield word, limit.setting, cause, int(row['limit_since_ns'])
        outside = int(row['doubts']) & doubts.OUTSIDE
        if bool(outside) != bool(int(before['doubts']) & doubts.OUTSIDE):
            stamp_ns = int(row['stamp_ns'])
            word, cause = 'motion_outside_range', outside_words(row)
            if outside:
                self._began_ns['outside'] = stamp_ns
            else:
                word, cause = f'{word}_over', f'none is left{self._after("outside", stamp_ns)}'
            yield word, 'frequency_range', cause, stamp_ns
        was, state = State(int(before['state'])), State(int(row['state']))
        if state != was:
            self.test, self.decided = state_cause(row, self.basis)
            self.decided_ns = int(row['stamp_ns'])
            if {state, was} & _STATES:
                yield state.label, self.test, self.decided, int(row['state_since_ns'])

    def _channel(self, name: str, old: int, row: np.void) -> Iterator[_Change]:
        new, stamp_ns = int(row[f'{name}_wrong']), int(row['stamp_ns'])
        over_ns = stamp_ns - round(health.FAULT_HOLD_S * NANOSECONDS)
        timeout_ns = self.basis.config.timeout_ns(name)
        if (new ^ old) & health.MISSING:
            if new & health.MISSING:
                since_ns = self._began_ns[f'{name} silent'] = stamp_ns - timeout_ns
                cause = f'{name}: silent for {timeout_ns / NANOSECONDS:g} s'
                if new & health.ABSENT:
                    cause += f', but it is optional: {health.COSTS[name]}'
                yield 'input_stale', 'timeout', cause, since_ns
            else:
                cause = f'{name} is back{self._after(f"{name} silent", over_ns)}'
                yield 'input_recovered', 'timeout', cause, over_ns
        if new & health.FAULTS & ~old:
            # How long a fault has lasted when it is found, s.
            ages = {
                health.NO_VALUE: timeout_ns / NANOSECONDS,
                health.STUCK: health.stuck_s(self.basis.config, name),
                health.CONTRADICTED: CONTRADICTED_S,
            }
            found = {
                bit: ages.get(bit, 0.0) for bit in health.WORDS if new & health.FAULTS & ~old & bit
            }
            since_ns = stamp_ns - round(max(found.values()) * NANOSECONDS)
            self._began_ns.setdefault(f'{name} fault', since_ns)
            told = []
            for bit, age in found.items():
                by = f' by more than {TOLERANCE_MPS:g} m/s' if bit == health.CONTRADICTED else ''
                told.append(health.WORDS[bit] + by + (f' for {age:.3g} s' if age else ''))
            yield 'sensor_fault', 'sensor', f'{name}: {", ".join(told)}', since_ns
        elif old & health.FAULTS and not new & health.FAULTS:
            cause = f'{name}: no fault is left{self._after(f"{name} fault", over_ns)}'
            yield 'sensor_recovered', 'sensor', cause, over_ns

    def _after(self, what: str, over_ns: int) -> str:
        """Say how long something lasted that is over; '' where that is not known."""
        lasted_ns = over_ns - self._began_ns.pop(what, over_ns + 1)  # or the clock was set back
        return f' after {lasted_ns / NANOSECONDS:.2f} s' if lasted_ns >= 0 else ''

    def status(
        self, door: Door, alarm: bool, history: AlarmHistory, sequence: int
    ) -> DetectorStatus:
        """
        Return the present view.

        Parameters
        ----------
        door : Door
            What the channels refused, their clocks, and those that the others wait for: then the
            row is an old one, and its level STALE.
        alarm : bool
            In force, also before the first row.
        history : AlarmHistory
            The alarms there were.
        sequence : int
            Number of rows so far.
        """
        offsets, behind = door.clock_offsets_s, door.behind
        refused = [
            f'{name}: clocks differ by {abs(offsets[name]):.1f} s,'
            f' more than the {1e-9 * CLOCK_OFFSET_NS:g} s that are followed'
            for name, channel in door.channels.items()
            if not channel.clock.believed
        ]
        if not sequence:
            row, until_ns, level = no_row(), 0, Level.STALE
            reasons = ['no data yet', *refused]
        else:
            row = self.row
            until_ns = int(row['stamp_ns']) if door.watermark_ns is None else door.watermark_ns
            level = Level.STALE if behind else Level(int(row['level']))
            apart = {
                f'{name}: {health.WORDS[health.CLOCK]}': f' by {abs(offset):.1f} s'
                for name, offset in offsets.items()
            }
            reasons = [told + apart.get(told, '') for told in self.reasons(row)]
            reasons += [*behind, *refused]
            reasons += [
                f'{name}: {channel.refused_since} samples refused for their stamps'
                for name, channel in door.channels.items()
                if channel.refused_since
            ]
        state, region = State(int(row['state'])), Region(int(row['region']))
        absent, dropped, basis = absent_words(row), door.dropped, self.basis
        # Where no rows come the last one does not tell all: `inputs`, never out of service.
        blind = ['inputs'] if behind or not until_ns else []
        causes = [*causes_of(row), *blind, *(history.codes if alarm else [])]
        values: dict[str, object] = {
            'state': state.label,
            'region': region.label,
            'alarm': alarm,
            'causes': ' '.join(dict.fromkeys(causes)),
            # What cannot be told from a line of the roller is a doubt of another kind.
            'undecided': int(row['doubts']) & (doubts.SETTLING | doubts.ON_LINE)
            == doubts.SETTLING,
            'sequence': sequence,
            'inputs_until_ns': until_ns,
            'since_s': seconds_text(self.level_since_ns),
            'test': self.test,
            'state_since_s': seconds_text(int(row['state_since_ns'])),
            'state_decided_s': seconds_text(self.decided_ns),
            'normal_form': basis.normal_form,
            'v_n_mps': basis.v_n if basis.v_n > 0.0 else math.nan,  # no number where it is unknown
            'v_c_mps': basis.v_c,
            'fold_amplitude_m': basis.fold_amplitude,
            'absent': '; '.join(absent),
            **{name: '' if x is None else x for name, x in history.totals().items()},
            **{public: float(row[name]) for name, public in PUBLIC.items()},
            **{f'dropped {what}': count for what, count in dropped.items()},
            **{f'clock_offset_s {name}': x for name, x in offsets.items()},
        }
        stamp_ns = int(row['stamp_ns'])
        return DetectorStatus(
            stamp_ns, level, region, state, alarm, tuple(reasons), absent, dropped, offsets, values
        )
