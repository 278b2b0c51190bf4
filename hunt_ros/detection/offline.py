"""What a record needs before it goes through the detector, and what came of it then."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.criteria import Verdict
from hunt_ros.detection import doubts
from hunt_ros.detection.companions import Companions, criterion_event
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.detector import HuntingDetector
from hunt_ros.detection.estimates import line_orders, roller_diameter
from hunt_ros.detection.output import Event, Output, numbers_behind
from hunt_ros.detection.regions import Level, Region
from hunt_ros.detection.words.alarms import AlarmHistory
from hunt_ros.detection.words.reasons import reason_counts
from hunt_ros.estimation.record_lines import RecordLines
from hunt_ros.estimation.record_motion import motion_of, turns_per_metre
from hunt_ros.forecast import Forecast
from hunt_ros.samples import Record


@dataclass
class Findings:
    """
    What came of a record.

    Parameters
    ----------
    period_ns : int
        From row to row.
    history : AlarmHistory
        The alarms.
    level_rows, region_rows : Counter
        Rows on each level and in each region. There are none while all channels are silent: that
        time is counted in such rows too, as stale and of no known region.
    reason_rows : Counter
        Rows that each reason, in words, made WARN or worse.
    max_amplitude_m : float
        Largest amplitude of the hunting component, m: that of the row, of those with a sensor
        to trust, whose amplitude less its standard deviation is the largest. It counts for no
        more than half the range of the readings within the last seconds: while the filter
        starts, and after a kick, it may be far off. NaN where nothing was known.
    events : list of Event
        Transitions of the detector, and of the criteria.
    verdicts : list of Verdict
        Railway criteria that began or ceased to exceed their limit.
    forecast : Forecast or None
        Of v_c, from the quiet response of the whole record; None where none was made.
    blind : bool
        Not even of yaw an amplitude was known anywhere.
    """

    period_ns: int
    history: AlarmHistory
    level_rows: Counter[str] = field(default_factory=Counter)
    region_rows: Counter[str] = field(default_factory=Counter)
    reason_rows: Counter[str] = field(default_factory=Counter)
    max_amplitude_m: float = math.nan
    events: list[Event] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    forecast: Forecast | None = None
    blind: bool = True
    _least_m: float = field(default=-math.inf, repr=False)
    _last_ns: int | None = field(default=None, repr=False)

    def add(self, rows: NDArray[np.void]) -> None:
        """Take in rows of estimates, at least one."""
        for column, kind, counter in (
            ('level', Level, self.level_rows),
            ('region', Region, self.region_rows),
        ):
            numbers, counts = np.unique(rows[column], return_counts=True)
            for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
                counter[kind(number).label] += count
        self.reason_rows += reason_counts(rows)
        stamps = rows['stamp_ns']
        steps = np.diff(stamps, prepend=stamps[0] if self._last_ns is None else self._last_ns)
        self._last_ns = int(stamps[-1])
        silent = int((steps[steps > self.period_ns] // self.period_ns - 1).sum())
        self.level_rows += Counter({Level.STALE.label: silent})
        self.region_rows += Counter({Region.UNKNOWN.label: silent})
        self.reason_rows += Counter({'all channels are silent': silent})
        self.blind &= not np.isfinite(rows['judged']).any()
        from_yaw = (rows['doubts'] & doubts.FROM_YAW) != 0
        # Where no lateral displacement is read there is nothing to compare it with.
        most = np.where(from_yaw, math.nan, rows['lateral_swing'])
        most[~(most >= 0.0)] = math.inf
        amplitude = np.minimum(rows['lateral_amplitude'], most)
        least = amplitude - rows['lateral_amplitude_std']
        blind = np.where(from_yaw, rows['yaw_blind'], rows['lateral_blind'])
        least[~np.isfinite(least) | blind] = -math.inf
        best = int(np.argmax(least))
        if least[best] > self._least_m:
            self._least_m, self.max_amplitude_m = float(least[best]), float(amplitude[best])


def config_for(record: Record, config: DetectorConfig) -> tuple[DetectorConfig, list[str]]:
    """
    Fit the settings to what a record has; what it lacks is said, not assumed.

    Parameters
    ----------
    record : Record
        The record.
    config : DetectorConfig
        The settings asked for.

    Returns
    -------
    config : DetectorConfig
        Without the channels that the record lacks.
    remarks : list of str
        One line for each thing that follows from it.
    """
    missing = [name for name in config.channels if not len(record.get(name, ()))]
    if not missing:
        return config, []
    remarks = [f'no {name} channel in the recording' for name in missing]
    present = tuple(name for name in config.channels if name not in missing)
    optional = tuple(name for name in config.optional_channels if name in present)
    found = replace(config, channels=present, optional_channels=optional)
    if 'roller' in missing and any(config.lines):
        assumed = '' if config.roller_diameter_m else ' (assumed, set roller_diameter_m)'
        remarks[missing.index('roller')] += (
            f': its lines are where the speed has them on a roller of'
            f' {roller_diameter(config):g} m{assumed}'
        )
    return found, remarks


def frequency_for(
    record: Record, config: DetectorConfig, known: bool = False
) -> tuple[DetectorConfig, list[str]]:
    """
    Take the nominal frequency from a record whose hunting is not in the usual range.

    Parameters
    ----------
    record : Record
        All of it decides.
    config : DetectorConfig
        Left as it is where it names a hunting frequency.
    known : bool
        True where something else tells the frequency, as a normal form does.

    Returns
    -------
    config : DetectorConfig
        With the frequency that was found outside the range, or unchanged.
    remarks : list of str
        One line where it was changed, and one for each forced line that is not a known one.
    """
    turns = turns_per_metre(record, config.roller_diameter_m)
    named = [order * turns for order in line_orders(config) if math.isfinite(turns)]
    lines = RecordLines([motion_of(record)], known=named)
    remarks = [line.words(turns) for line in lines.unknown()]
    if known or config.hunting_frequency_hz > 0.0:
        return config, remarks
    (low, high), found = config.followed_hz, lines.hunting_hz
    if found is None or low <= found <= high:
        return config, remarks
    remark = (
        f'the motion whose amplitude changes most is at {found:.3g} Hz, outside the hunting'
        f' frequencies {low:.3g} to {high:.3g} Hz: it is taken for the hunting'
        ' (set hunting_frequency_hz if it is not)'
    )
    return replace(config, hunting_frequency_hz=found), [remark, *remarks]


def collect(
    outputs: Iterator[Output],
    detector: HuntingDetector,
    companions: Companions | None = None,
) -> Findings:
    """
    Add up what a detector said, and what runs beside it.

    Parameters
    ----------
    outputs : iterator of Output
        As from `replay.watch`.
    detector : HuntingDetector
        Which they come from.
    companions : Companions, optional
        Fed with the outputs, and finished at their end.
    """
    found = Findings(detector.config.period_ns, detector.history)
    for output in outputs:
        if output.estimates.size:
            found.add(output.estimates)
        events = list(output.events)
        if companions is not None:
            verdicts = companions.update(output.motion)
            found.verdicts += verdicts
            events += [_event_of(verdict, output.estimates) for verdict in verdicts]
            if verdicts:
                events.sort(key=lambda event: event.stamp_ns)
        found.events += events
    if companions is not None:
        found.forecast = companions.finish()
    return found


def _event_of(verdict: Verdict, rows: NDArray[np.void]) -> Event:
    """Put a verdict among the events, at the first row that could know it."""
    row = rows[min(int(np.searchsorted(rows['stamp_ns'], verdict.stamp_ns)), rows.size - 1)]
    level = Level(int(row['level']))
    return criterion_event(verdict, int(row['stamp_ns']), level, numbers_behind(row))
