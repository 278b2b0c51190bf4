"""What `hunt replay` says of a recording: JSON for machines, lines for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from hunt_ros.cli.support.screen import event_line
from hunt_ros.dashboard.words import Words
from hunt_ros.detection import DetectorConfig
from hunt_ros.detection.offline import Findings
from hunt_ros.detection.output import EVENT_NUMBERS
from hunt_ros.detection.regions import Level, Region
from hunt_ros.forecast import Forecast
from hunt_ros.samples import Record, counted, known


def document(
    record: Record, config: DetectorConfig, found: Findings, remarks: Sequence[str]
) -> dict[str, Any]:
    """
    Return what was found, as JSON.

    `summary.forecast` is the forecast of v_c from the quiet response: `v_c_mps`, `std` and
    `ci95` are null where it cannot be known, for the `reason` given; it is null itself where
    none was asked for. A railway criterion that begins or ceases to exceed its limit stands
    among the events, and with its numbers in `criteria`. An event has the numbers behind its
    `cause`, all that there are, null where unknown, and the `normal_form` in force; `alarms` is
    the history of the alarms as the live detector keeps it. `warnings` says what the recording
    lacks and what is wrong with it.
    """
    row_s = config.period_ns / 1e9

    def seconds(stamp_ns: int) -> float:
        """Return a stamp in seconds from the start of the recording."""
        return (stamp_ns - record.start_ns) / 1e9

    return {
        'summary': {
            'duration_s': _lasted_s(found),
            'samples': sum(len(series) for series in record.values()),
            'level_time_s': {
                level.label: row_s * found.level_rows[level.label] for level in Level
            },
            'region_time_s': {
                region.label: row_s * found.region_rows[region.label] for region in Region
            },
            'reason_time_s': {words: row_s * n for words, n in found.reason_rows.most_common()},
            'max_amplitude_m': known(found.max_amplitude_m),
            'forecast': _forecast(found.forecast),
        },
        'events': [
            {
                't_s': seconds(event.stamp_ns),
                'since_s': seconds(event.since_ns),
                'event': event.event,
                'level': event.level.label,
                'test': event.test,
                'cause': event.cause,
                'normal_form': event.normal_form or None,
                **{name: known(event.numbers.get(name)) for name in EVENT_NUMBERS},
            }
            for event in found.events
        ],
        'alarms': found.history.to_json(record.start_ns),
        'criteria': [
            {
                't_s': seconds(verdict.stamp_ns),
                'criterion': verdict.criterion,
                'exceeded': verdict.exceeded,
                'index_mps2': known(verdict.index),
                'limit_mps2': verdict.limit,
            }
            for verdict in found.verdicts
        ],
        'warnings': list(remarks),
    }


def lines_of(
    record: Record,
    config: DetectorConfig,
    found: Findings,
    remarks: Sequence[str],
    speed_unit: str,
) -> list[str]:
    """Return remarks, events in their order, and the summary as lines for a person."""
    lines = list(remarks)
    for event in found.events:
        texts = {name: str(value) for name, value in event.numbers.items()}
        texts |= {'stamp_ns': str(event.stamp_ns), 'event': event.event, 'message': event.cause}
        lines.append(event_line(texts, record.start_ns))
    row_s = config.period_ns / 1e9
    times = ', '.join(f'{name} {row_s * n:.1f} s' for name, n in found.level_rows.items())
    largest = 1e3 * found.max_amplitude_m
    most = f'{largest:.3f} mm' if math.isfinite(largest) else '-'
    lines.append(f'{_lasted_s(found):.1f} s: {times}; largest amplitude {most}')
    for words, rows in found.reason_rows.most_common():
        lines.append(f'  {row_s * rows:8.1f} s  {words}')
    if (forecast := found.forecast) is not None:
        told = f'unknown ({forecast.reason})'
        if (speed := forecast.critical_speed) is not None:
            told = f'{speed.with_interval("m/s")}, {counted(forecast.levels, "speed level")}'
        lines.append(f'v_c from the quiet response: {told}')
    return list(map(Words(speed_unit).in_unit, lines))


def _lasted_s(found: Findings) -> float:
    """Return the time from the first row to the last, which no clock that was set changes."""
    return max(found.level_rows.total() - 1, 0) * found.period_ns / 1e9


def _forecast(forecast: Forecast | None) -> dict[str, Any] | None:
    if forecast is None:
        return None
    critical = forecast.critical_speed
    told = (critical and critical.to_json()) or {'value': None, 'std': None, 'ci95': None}
    return {
        'v_c_mps': told.pop('value'),
        **told,
        'reason': forecast.reason,
        'law': forecast.law,
        'levels': forecast.levels,
    }
