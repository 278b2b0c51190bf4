"""`hunt replay BAG`: a recording through the detector, offline or through the running nodes."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.errors import ConfigError
from hunt_ros.suite import PAGE_PORT

if TYPE_CHECKING:
    from hunt_ros.detection import CompanionConfig, Companions, DetectorConfig
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.samples import Record

SUMMARY = 'run a recording through the detector; --live: through the running nodes'
EXAMPLE = 'hunt replay bags/kick_escapes --normal-form bags/paper.yaml --json -'


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('bag', type=Path, help='folder, .mcap or .db3')
    options.add_normal_form(parser)
    options.add_rig(parser)
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='one setting of hunting_detector, e.g. criteria=[cfr_213_333]; repeatable',
    )
    options.add_channels(parser)
    options.add_json(parser, 'summary and events')
    parser.add_argument(
        '--fresh',
        action='store_true',
        help='a new run with default settings, also where the recording holds a live one',
    )
    parser.add_argument('--live', action='store_true', help='publish it to the running nodes')
    live = parser.add_argument_group('with --live only')
    options.add_pace(live, 50.0, None)
    options.add_stretch(live)
    live.add_argument('--loop', action='store_true', help='begin anew at the end')
    options.add_namespace(live, None)
    options.add_page(live, str(PAGE_PORT))


def run(arguments: argparse.Namespace) -> int:
    """Replay; offline unless --live."""
    _check(arguments)
    if arguments.live:
        from hunt_ros.cli.support.live_replay import replay_live

        return replay_live(arguments, read(arguments))  # fails before anything starts
    from hunt_ros.cli.support.output import progress, write_json
    from hunt_ros.cli.support.replay_report import document, tell
    from hunt_ros.detection import HuntingDetector
    from hunt_ros.detection.offline import collect, config_for, watch
    from hunt_ros.detection.record_frequency import frequency_for
    from hunt_ros.detection.replay import missing_samples, replay_journal, unheard_samples
    from hunt_ros.recorded_run import recorded_run

    record = read(arguments)
    asked, beside = _settings(arguments)
    config, remarks = config_for(record, asked)
    live = None if _asks_for_another_run(arguments) else recorded_run(arguments.bag)
    with progress(f'replaying {arguments.bag.name}') as advance:
        if live is not None:
            config, beside = live.config, live.companions
            remarks = ['the live run of this recording, with its settings and journal']
            if live.unknown:
                names = ', '.join(live.unknown)
                remarks.append(
                    f'settings of the recording that this version does not have: {names}'
                )
            remarks += _differences(
                missing_samples(record, live.journal), unheard_samples(record, live.journal)
            )
            remarks += frequency_for(record, config, known=True)[1]
            detector = HuntingDetector(config)
            outputs = iter([replay_journal(detector, record, live.journal)])
        else:
            form = read_form(arguments.normal_form) if arguments.normal_form else None
            config, more = frequency_for(record, config, known=form is not None)
            remarks += more
            detector = HuntingDetector(config, form)
            outputs = watch(record, detector, advance)
        found = collect(outputs, _companions(beside, config), detector)
    remarks += _damage(record)
    if arguments.json:
        write_json(document(record, config, found, remarks), arguments.json)
    if arguments.json != '-':
        tell(record, config, found, remarks)
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """Refuse options that would have no effect."""
    options.check_stretch(arguments)
    if arguments.live:
        return
    names = {
        'pace': '--pace',
        'start': '--from',
        'end': '--to',
        'namespace': '--namespace',
        'page': '--page',
    }
    without = [option for name, option in names.items() if getattr(arguments, name) is not None]
    without += ['--loop'] if arguments.loop else []
    if without:
        raise ConfigError(f'{without[0]}: only with --live, the whole recording is replayed')


def _asks_for_another_run(arguments: argparse.Namespace) -> bool:
    """Return True if anything was given that the live run of the recording did not have."""
    given = (arguments.normal_form, arguments.rig, arguments.set, arguments.channel)
    return arguments.fresh or arguments.mapping is not None or any(given)


def read(arguments: argparse.Namespace) -> Record:
    """Read the measurements, with the channels the user named."""
    from hunt_ros.bag import check_units, read_record
    from hunt_ros.samples import CHANNELS
    from hunt_ros.sensors import DISPLACEMENTS

    channels = options.channels_of(arguments, CHANNELS)
    constant_speed = options.rig_of(arguments).constant_speed_mps > 0.0 or any(
        word.startswith('constant_speed_mps=') for word in arguments.set
    )
    require = () if constant_speed else ('speed',)
    record = read_record(arguments.bag, channels, require=require)
    options.rig_of(arguments).refuse_other(record.notes.get('rig', ''), record.source)
    if not set(DISPLACEMENTS) & set(record):
        neither = ' nor '.join(DISPLACEMENTS)
        raise ConfigError(f'{arguments.bag}: neither {neither} in it, expected one of them')
    return check_units(record)


def _differences(missing: Mapping[str, int], unheard: Mapping[str, int]) -> list[str]:
    """Say that the numbers are not those of the live run, and why."""
    found = []
    for text, counts in (
        ('the recording lacks samples that the live detector had', missing),
        ('the recording has samples that did not reach the live detector', unheard),
    ):
        if counts:
            told = ', '.join(f'{count} of {name}' for name, count in counts.items())
            found.append(f'{text} (at least {told}): its numbers were others')
    return found


def _damage(record: Record) -> list[str]:
    """Say what opening the recording showed to be wrong: its end may be missing."""
    problems = record.notes.get('problems')
    return [f'damaged: {problems}; "hunt info" says more'] if problems else []


def read_form(path: Path) -> IdentifiedNormalForm:
    """Read a parameter file of `hunt identify --out`."""
    from hunt_ros.dynamics.identified import IdentifiedNormalForm

    text = options.read_text(path, 'normal form')
    return IdentifiedNormalForm.from_yaml(text, str(path))


def _settings(arguments: argparse.Namespace) -> tuple[DetectorConfig, CompanionConfig]:
    """Read the settings of the detector node: those of the detector, and what runs beside it."""
    from hunt_ros.cli.support.settings_file import read_settings
    from hunt_ros.detection import CompanionConfig, DetectorConfig

    where = 'hunting_detector', arguments.rig, arguments.set
    config = read_settings(DetectorConfig, *where, others=[CompanionConfig])
    return config, read_settings(CompanionConfig, *where, others=[DetectorConfig])


def _companions(beside: CompanionConfig, config: DetectorConfig) -> Companions:
    """Make criteria and forecast; the forecast is made once, from the whole recording."""
    from hunt_ros.detection import Companions
    from hunt_ros.dynamics.parameters import RigParameters

    rig = None
    if beside.forecast == 'wheelset' and beside.forecast_rig:
        path = Path(beside.forecast_rig)
        rig = RigParameters.from_yaml(options.read_text(path, 'rig'), str(path))
    return Companions.of(beside, config, rig, live=False)
