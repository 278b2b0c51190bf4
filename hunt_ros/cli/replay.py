"""`hunt replay BAG`: a recording through the detector, offline or through the running nodes."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.errors import ConfigError

if TYPE_CHECKING:
    from hunt_ros.detection import CompanionConfig, Companions, DetectorConfig
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.samples import Record

SUMMARY = 'run a recording through the detector; --live: through the running nodes'
EXAMPLE = 'hunt replay bags/kicks --normal-form normal_form.yaml --json -'


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('bag', type=Path, help='folder, .mcap or .db3')
    parser.add_argument(
        '--normal-form', type=Path, metavar='FILE', help='parameter file of hunt identify --out'
    )
    parser.add_argument(
        '--params',
        type=Path,
        action='append',
        default=[],
        metavar='FILE',
        help='ROS parameter file with settings of hunting_detector; repeatable',
    )
    parser.add_argument(
        '--param',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='one setting of hunting_detector, e.g. criteria=[cfr_213_333]; repeatable',
    )
    parser.add_argument(
        '--channel',
        action='append',
        default=[],
        metavar='NAME=SOURCE',
        help='lateral=/daq/ch0.data[3]*0.001, or a constant: speed=16.3',
    )
    parser.add_argument('--mapping', type=Path, metavar='FILE', help='the same, as YAML')
    parser.add_argument('--json', metavar='PATH', help="summary and events as JSON; '-': stdout")
    parser.add_argument(
        '--fresh',
        action='store_true',
        help='a new run with default settings, also where the recording holds a live one',
    )
    live = parser.add_argument_group('live')
    live.add_argument('--live', action='store_true', help='publish it to the running nodes')
    live.add_argument('--rate', type=float, default=1.0, help='0.1 to 50 (default: %(default)s)')
    live.add_argument('--from', dest='start', type=float, default=0.0, metavar='S')
    live.add_argument('--to', dest='end', type=float, metavar='S')
    live.add_argument('--loop', action='store_true', help='begin anew at the end')
    live.add_argument('--namespace', default='rig', help='ROS namespace (default: %(default)s)')


def run(arguments: argparse.Namespace) -> int:
    """Replay; offline unless --live."""
    if arguments.live:
        from hunt_ros.cli.live_replay import replay_live

        return replay_live(arguments)
    from hunt_ros.cli.output import progress, write_json
    from hunt_ros.cli.recorded_run import recorded_run
    from hunt_ros.cli.replay_report import document, tell
    from hunt_ros.detection import HuntingDetector
    from hunt_ros.detection.offline import collect, config_for, watch
    from hunt_ros.detection.record_frequency import frequency_for
    from hunt_ros.detection.replay import missing_samples, replay_journal

    record = read(arguments)
    asked, beside = _settings(arguments)
    config, remarks = config_for(record, asked)
    live = None if _asks_for_another_run(arguments) else recorded_run(arguments.bag)
    with progress(f'replaying {arguments.bag.name}') as advance:
        if live is not None:
            config, beside = live.config, live.companions
            remarks = ['the live run of this recording, with its settings and journal']
            remarks += _differences(missing_samples(record, live.journal))
            outputs = iter([replay_journal(HuntingDetector(config), record, live.journal)])
        else:
            form = read_form(arguments.normal_form) if arguments.normal_form else None
            if form is None:
                config, more = frequency_for(record, config)
                remarks += more
            outputs = watch(record, HuntingDetector(config, form), advance)
        found = collect(outputs, _companions(beside, config))
    remarks += _damage(record)
    if arguments.json:
        write_json(document(record, config, found, remarks), arguments.json)
    if arguments.json != '-':
        tell(record, config, found, remarks)
    return 0


def _asks_for_another_run(arguments: argparse.Namespace) -> bool:
    """Tell whether anything was given that the live run of the recording did not have."""
    given = (arguments.normal_form, arguments.params, arguments.param, arguments.channel)
    return arguments.fresh or arguments.mapping is not None or any(given)


def read(arguments: argparse.Namespace) -> Record:
    """Read the measurements, with the channels the user named."""
    from hunt_ros.bag import ChannelSource, read_channel_file, read_record

    mapping = dict(read_channel_file(arguments.mapping)) if arguments.mapping else {}
    for word in arguments.channel:
        source = ChannelSource.parse(word)
        mapping[source.channel] = source
    constant_speed = any(word.startswith('constant_speed_mps=') for word in arguments.param)
    require = () if constant_speed else ('speed',)
    record = read_record(arguments.bag, mapping, require=require)
    if not {'lateral', 'yaw'} & set(record):
        raise ConfigError(f'{arguments.bag}: neither lateral nor yaw in it, expected one of them')
    return record


def _differences(missing: Mapping[str, int]) -> list[str]:
    """Say that the numbers are not those of the live run, and why."""
    if not missing:
        return []
    lacks = ', '.join(f'{count} of {name}' for name, count in missing.items())
    return [
        f'the recording lacks samples that the live detector had (at least {lacks}):'
        ' its numbers were others'
    ]


def _damage(record: Record) -> list[str]:
    """Say what opening the recording showed to be wrong: its end may be missing."""
    problems = record.notes.get('problems')
    return [f'damaged: {problems}; "hunt info" says more'] if problems else []


def read_form(path: Path) -> IdentifiedNormalForm:
    """Read a parameter file of `hunt identify --out`."""
    from hunt_ros.dynamics.identified import IdentifiedNormalForm

    try:
        text = path.read_text(encoding='utf-8')
    except OSError as error:
        raise ConfigError(f'{path}: cannot read the normal form ({error.strerror})') from error
    return IdentifiedNormalForm.from_yaml(text, str(path))


def _settings(arguments: argparse.Namespace) -> tuple[DetectorConfig, CompanionConfig]:
    """Read the settings of the detector node: those of the detector, and what runs beside it."""
    from hunt_ros.cli.settings_file import read_settings
    from hunt_ros.detection import CompanionConfig, DetectorConfig

    where = 'hunting_detector', arguments.params, arguments.param
    config = read_settings(DetectorConfig, *where, others=[CompanionConfig])
    return config, read_settings(CompanionConfig, *where, others=[DetectorConfig])


def _companions(beside: CompanionConfig, config: DetectorConfig) -> Companions:
    """Make criteria and forecast; the forecast is made once, from the whole recording."""
    from hunt_ros.detection import Companions
    from hunt_ros.dynamics.parameters import RigParameters

    rig = None
    if beside.forecast == 'wheelset' and beside.forecast_rig:
        path = Path(beside.forecast_rig)
        try:
            rig = RigParameters.from_yaml(path.read_text(encoding='utf-8'), str(path))
        except OSError as error:
            raise ConfigError(f'{path}: cannot read the rig ({error.strerror})') from error
    return Companions.of(beside, config.channels, rig, live=False)
