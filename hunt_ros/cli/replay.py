"""`hunt replay BAG`: a recording through the detector, offline or through the running nodes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hunt_ros.bag import Bag, check_units, read_record
from hunt_ros.bursts import evened
from hunt_ros.cli.support import options
from hunt_ros.cli.support.live_replay import replay_live
from hunt_ros.cli.support.output import Found, progress
from hunt_ros.cli.support.recorded_run import RecordedRun, recorded_run
from hunt_ros.cli.support.replay_report import document, lines_of
from hunt_ros.detection import CompanionConfig, Companions, DetectorConfig, HuntingDetector
from hunt_ros.detection.offline import collect, config_for, frequency_for
from hunt_ros.detection.replay import detect, samples_apart, watch
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import ConfigError
from hunt_ros.rig import refuse_other
from hunt_ros.samples import CHANNELS, Record
from hunt_ros.sensors import DISPLACEMENTS

#: Of the detector, and of what runs beside it.
_KINDS: tuple[Any, ...] = (DetectorConfig, CompanionConfig)

EXAMPLE = 'hunt replay bags/kick_escapes --normal-form bags/paper.yaml --json -'


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    parser.add('bag', type=Path, help='folder, .mcap or .db3')
    parser.add('--normal-form', '--rig', '--channel')
    options.add_set(parser, 'criteria=[cfr_213_333]', {}, hunting_detector=_KINDS)
    what = 'a new run with default settings, also where the recording holds a live one'
    parser.add('--fresh', **options.FLAG, help=what)
    parser.add('--live', **options.FLAG, help='publish it to the running nodes')
    live = parser.add_argument_group('with --live only')
    options.add(
        live, '--pace', type=options.number(0.1, 50.0), help='seconds of the rig in a second (1)'
    )
    options.add(live, '--from', '--to', '--namespace', '--page')


def run(arguments: argparse.Namespace) -> Found | int:
    """Replay; offline unless --live."""
    options.check_stretch(arguments)
    if not arguments.live:
        live_alone = ('--pace', '--from', '--to', '--namespace', '--page')
        why = 'only with --live, the whole recording is replayed'
        options.refuse_given(arguments, live_alone, why)
    others = (arguments.normal_form, arguments.rig, arguments.set, arguments.channel)
    another = arguments.fresh or arguments.live or any(others)  # than the live run of it
    with Bag(arguments.bag) as bag:
        live = None if another else recorded_run(bag)
        record = read(arguments, bag, as_stamped=live is not None)
    asked, beside = options.settings_of(arguments, 'hunting_detector', *_KINDS)
    if arguments.live:
        return replay_live(arguments, record, (asked, beside))
    config, remarks = config_for(record, asked)
    with progress(f'replaying {arguments.bag.name}') as advance:
        if live is not None:
            config, beside = live.config, live.companions
            remarks = _of_the_live_run(record, live)
            remarks += frequency_for(check_units(record), config, known=True)[1]
            detector = HuntingDetector(config)
            outputs = iter([detect(detector, record, live.journal)])
        else:
            form = (
                IdentifiedNormalForm.read(arguments.normal_form) if arguments.normal_form else None
            )
            config, more = frequency_for(record, config, known=form is not None)
            remarks += more
            detector = HuntingDetector(config, form)
            outputs = watch(record, detector, advance)
        # The forecast is made once, from the whole recording.
        rig = RigParameters.read(beside.forecast_rig) if beside.forecast == 'wheelset' else None
        found = collect(outputs, detector, Companions(beside, config, rig, live=False))
    if problems := record.notes.get('problems'):  # its end may be missing
        remarks.append(f'damaged: {problems}; "hunt info" says more')
    if bursts := record.notes.get('bursts'):
        remarks.append(bursts)
    if found.blind:
        remarks.append('no amplitude of the hunting could be estimated: it may hunt or not')
    told = record, config, found, remarks
    unit = options.rig_of(arguments).speed_unit
    return Found(document(*told), lines_of(*told, unit), 1 if found.blind else 0)


def read(
    arguments: argparse.Namespace, bag: Bag | None = None, as_stamped: bool = False
) -> Record:
    """Read the measurements, with the channels the user named; see `read_record`."""
    channels = options.channels_of(arguments, CHANNELS)
    rig = options.rig_of(arguments)
    require = () if rig.constant_speed_mps > 0.0 else ('speed',)
    record = read_record(bag or arguments.bag, channels, require=require, as_stamped=as_stamped)
    refuse_other(record.notes.get('rig', ''), rig.rig_name, record.source)
    if not set(DISPLACEMENTS) & set(record):
        neither = ' nor '.join(DISPLACEMENTS)
        raise ConfigError(f'{arguments.bag}: neither {neither} in it, expected one of them')
    possible = check_units(record)
    return record if as_stamped else possible  # the live run had them


def _of_the_live_run(record: Record, live: RecordedRun) -> list[str]:
    """Say that it is repeated, and whether the numbers are not those of then, and why."""
    found = ['the live run of this recording, with its settings and journal']
    if live.unknown:
        names = ', '.join(live.unknown)
        found.append(f'settings of the recording that this version does not have: {names}')
    if stamped := evened(record)[1]:
        found.append(f'{"; ".join(stamped)}, with --fresh')
    missing, unheard = samples_apart(record, live.journal)
    for text, counts in (
        ('lacks samples that the live detector had', missing),
        ('has samples that did not reach the live detector', unheard),
    ):
        if counts:
            told = ', '.join(f'{count} of {name}' for name, count in counts.items())
            found.append(f'the recording {text} (at least {told}): its numbers were others')
    return found
