"""`hunt check`: is the rig fit for monitoring? From its live topics, or from a recording."""

from __future__ import annotations

import argparse
import math
import shutil
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.rig_check import FAIL, OK, UNKNOWN, WARN, Finding, check_rig, judged
from hunt_ros.bag import channel_map, read_columns, read_record
from hunt_ros.bag.plausible import possible_readings, wrong_unit
from hunt_ros.bursts import evened
from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found, progress
from hunt_ros.cli.support.processes import NodeSpec, ask
from hunt_ros.detection import CompanionConfig, DetectorConfig
from hunt_ros.drivers.alarm_output import AlarmSettings
from hunt_ros.estimation.textbook import compared_amplitudes, unmoved
from hunt_ros.estimation.tracker_config import REFERENCE_HZ
from hunt_ros.identification.record.stops import without_stops
from hunt_ros.rig import UNSTOPPED, Rig, refuse_other
from hunt_ros.samples import CHANNELS, Record, Series, as_json
from hunt_ros.sensors import DISPLACEMENTS, lacking

EXAMPLE = 'hunt check bags/kick_decays --rig config/rig.yaml'

#: What to do where two filters differ.
_FILTERS = 'set hunting_frequency_hz and lines of the rig file; or a kernel computes wrongly'
#: Of a sample in a recording, with its share of everything else, bytes.
_SAMPLE_BYTES = 80.0
#: Half of the yaw of a wheelset is within this, rad: of degrees it is not while it hunts.
_YAW_RAD = 0.05
#: A recording must have room for so long, h, and for this at least, bytes.
_LEAST_H, _LEAST_BYTES, _WEEK_H = 8.0, 1e9, 168.0


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    parser.add('bag', nargs='?', type=Path, help='recording (default: the live topics)')
    parser.add('--rig', '--channel', '--namespace', '--directory')
    longest = options.number(0.0, 3600.0, 's', above=True)
    parser.add('--duration', type=longest, metavar='S', help='listen for S seconds (10)')


def run(arguments: argparse.Namespace) -> Found:
    """Check: 0 where nothing fails, 1 where something does."""
    rig = options.rig_of(arguments)
    options.settings_of(arguments, 'hunting_detector', DetectorConfig, CompanionConfig)
    if arguments.bag is not None:
        live = ('--duration', '--namespace', '--directory')
        options.refuse_given(arguments, live, 'only for live topics, the recording is checked')
        rig, record, arrivals, damage = _recorded(arguments, rig)
        more = []
    else:
        heard = _listen(arguments, rig)
        record, arrivals, damage = _live(heard)
        more = [*_publishers(heard, rig), _disk(record, options.recordings_of(arguments))]
        more += [_alarm(arguments), _watchdog(rig)]
    sound, stops = _without_stops(replace(record, channels=evened(record)[0]))
    findings = [*check_rig(record, sound, arrivals, rig), *more, *damage]
    findings += [*(units := _units(record)), *stops]
    if all(one.state != FAIL for one in units):  # else its numbers are none of a rig
        findings += _filters(sound, rig)
    failed = sum(finding.state == FAIL for finding in findings)
    document = {
        'source': str(arguments.bag) if arguments.bag else f'/{arguments.namespace or "rig"}',
        'rig_name': rig.rig_name,
        'failed': failed,
        'checks': as_json(findings),
    }
    return Found(document, _lines(findings), 1 if failed else 0)


def _recorded(
    arguments: argparse.Namespace, rig: Rig
) -> tuple[Rig, Record, dict[str, NDArray[np.int64]], list[Finding]]:
    """Read a recording, and when its messages came; without a rig file, what it holds or lacks."""
    sources = options.channels_of(arguments, CHANNELS)
    record, told = possible_readings(read_record(arguments.bag, sources, as_stamped=True))
    refuse_other(record.notes.get('rig', ''), rig.rig_name, str(arguments.bag))
    if not arguments.rig:
        rig = replace(rig, channels=(*record, *(either[0] for either in lacking(record))))
    named = {name: sources.get(name, name) for name in record}
    measured = [one for one in channel_map(named).values() if one.constant is None]
    came = {
        name: series.stamps_ns
        for name, series in read_columns(arguments.bag, measured, stamps='log').items()
        if len(series) == len(record[name])
    }
    told = [*filter(None, [record.notes.get('problems')]), *told]
    return rig, record, came, _damage(told, 'hunt info tells all that is wrong with it')


def _listen(arguments: argparse.Namespace, rig: Rig) -> dict[str, Any]:
    """Listen to the live topics."""
    seconds = 10.0 if arguments.duration is None else arguments.duration
    parameters = {'channels': rig.channels, 'seconds': float(seconds)}
    with progress(f'listening for {seconds:g} s'):
        return ask(NodeSpec('rig_listener', parameters), arguments.namespace or 'rig')


def _live(
    heard: Mapping[str, Any],
) -> tuple[Record, dict[str, NDArray[np.int64]], list[Finding]]:
    """Return what was heard as a record, and when it came."""
    filled = {name: one for name, one in heard.items() if one['values']}
    channels = {
        name: Series(np.array(one['stamps_ns']), np.array(one['values']))
        for name, one in filled.items()
    }
    record, told = possible_readings(Record(channels))
    arrivals = {name: np.array(one['arrivals_ns']) for name, one in filled.items()}
    return record, arrivals, _damage(told, 'look at the sensor, its cable and what reads it')


def _publishers(heard: Mapping[str, Any], rig: Rig) -> list[Finding]:
    """Return who publishes the channels, where it is not one node."""
    found = []
    for channel, one in heard.items():
        names, topic, state = one['publishers'], one['topic'], FAIL
        if len(names) == 1:
            continue
        text = f'{topic} has {len(names)} publishers: {", ".join(names)}'
        advice = 'end all but one, or start the second suite under another namespace'
        if not names:
            state = WARN if channel in rig.optional_channels else FAIL
            text = f'nobody publishes {topic}'
            advice = 'start its node; --namespace says where the topics of the rig are'
        found.append(Finding('publishers', channel, state, text, advice, float(len(names))))
    return found


def _damage(told: list[str], advice: str) -> list[Finding]:
    """Return what reading has shown to be wrong."""
    return [Finding('damage', '', WARN, f'damaged: {"; ".join(told)}', advice)] if told else []


def _units(record: Record) -> list[Finding]:
    """Return the channels that cannot be in SI, and what an import has assumed."""
    texts = {name: wrong_unit(name, series) for name, series in record.items()}
    advice = 'publish SI units (m, rad, m/s), or give the factor in "sources" of the rig file'
    found = [Finding('unit', name, FAIL, text, advice) for name, text in texts.items() if text]
    if 'yaw' in record and (text := wrong_unit('yaw', record['yaw'], _YAW_RAD)) and not found:
        advice = 'a wheelset yaws by some mrad; a wing or a model may by more'
        found.append(Finding('unit', 'yaw', WARN, text, advice))
    if assumed := record.notes.get('units_assumed'):
        text = f'the file that it was imported from tells no unit, assumed: {assumed}'
        advice = 'if that is wrong, import it again with a factor: --channel lateral=y*0.001'
        found.append(Finding('unit', '', WARN, text, advice))
    if clock := record.notes.get('clock'):
        advice = 'write times with more digits: a sample that was lost does not show'
        text = f'in the file that it was imported from {clock}'
        found.append(Finding('jitter', '', WARN, text, advice))
    return found


def _without_stops(record: Record) -> tuple[Record, list[Finding]]:
    """Return what `hunt identify` takes, and where a displacement sensor does not measure."""
    found = {name: without_stops(record[name]) for name in DISPLACEMENTS if name in record}
    channels = {**record, **{name: sound for name, (sound, _) in found.items()}}
    advice = (
        'hunt identify leaves this out, and the detector does not: look at range and cable of the'
        ' sensor, and at what reads it'
    )
    stops = ((name, text) for name, (_, text) in found.items() if text)
    findings = [Finding('range', name, WARN, text, advice) for name, text in stops]
    return replace(record, channels=channels), findings


def _filters(record: Record, rig: Rig) -> list[Finding]:
    """Return what is dead where another sensor moves, and whether two filters see one motion."""
    hunting = rig.hunting_frequency_hz or REFERENCE_HZ, [n for n in rig.lines if n > 0.0]
    advice = 'a wheelset that hunts moves both: look at its cable, its target and its scale'
    dead = unmoved(record, *hunting)
    found = [Finding('motion', name, FAIL, text, advice) for name, text in dead.items()]
    if find_spec('filterpy') is None:  # no package of Ubuntu or of ROS brings it
        text, advice = 'filterpy is not there', 'pip install filterpy'
        return [*found, Finding('filter', '', UNKNOWN, text, advice)]
    if both := compared_amplitudes(record, *hunting):
        apart = both[0] / both[1] - 1.0
        # A fixed filter leaves something of noise and of a beat.
        far = abs(apart) > 0.1
        text = f'the amplitude is {100 * apart:+.1f} % off that of a textbook Kalman filter'
        found.append(judged('filter', '', far, text, _FILTERS, apart, state=WARN))
    return found


def _disk(record: Record, directory: Path) -> Finding:
    """Return how long a recording fits on the disk."""
    place = options.place_of(directory)
    free = float(shutil.disk_usage(place).free)
    rate = sum(series.rate_hz for series in record.values() if math.isfinite(series.rate_hz))
    hours = free / max(rate * _SAMPLE_BYTES, 1.0) / 3600.0
    lasts = f'about {hours:.0f} h' if hours < _WEEK_H else 'more than a week'
    text = f'{free / 1e9:.1f} GB are free at {place}, for {lasts} of recording'
    advice = 'make room there, or record elsewhere with --directory'
    full = free < _LEAST_BYTES or hours < _LEAST_H
    return judged('disk', '', full, text, advice, free, 'byte')


def _alarm(arguments: argparse.Namespace) -> Finding:
    """Return who is called for an alarm; a program that is not there is no rig file."""
    named = AlarmSettings.told(options.rig_texts(arguments))
    if named:
        return Finding('alarm', '', OK, f'an alarm calls by {" and ".join(named)}', '')
    advice = 'name a sound, a command or a relay_coil in the section alarm_outputs of the rig file'
    return Finding('alarm', '', WARN, 'an alarm calls nobody', advice)


def _watchdog(rig: Rig) -> Finding:
    """Return what stops the roller where the machine dies."""
    after_s = rig.drive_watchdog_s
    if after_s:
        return Finding('drive', '', OK, f'the drive stops by itself after {after_s:g} s', '')
    advice = "set the drive's own watchdog, pull its cable once, and name drive_watchdog_s"
    return Finding('drive', '', WARN, UNSTOPPED, advice)


def _lines(findings: list[Finding]) -> list[str]:
    """Return a line a finding, and what to do below it."""
    lines = []
    for one in findings:
        what = f'{one.channel} {one.check}' if one.channel else one.check
        lines.append(f'{one.state:8}{what:20} {one.text}')
        if one.advice:
            lines.append(f'{"":8}{"":20} -> {one.advice}')
    counts = Counter(one.state for one in findings)
    seen = (state for state in (OK, WARN, FAIL, UNKNOWN) if counts[state])
    return [*lines, ', '.join(f'{counts[state]} {state}' for state in seen)]
