"""What `identify`, `plan` and `report` share: options, recordings, the identification."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.errors import HuntError

if TYPE_CHECKING:
    from hunt_ros.bag import ChannelSource
    from hunt_ros.cli.support.output import Advance
    from hunt_ros.identification import Identification, IdentificationSettings, Source
    from hunt_ros.rig import Rig
    from hunt_ros.samples import Record

#: Whose section of a parameter file is read as well: it does the same in a running suite.
NODE = 'normal_form_identifier'


def add_settings(parser: argparse.ArgumentParser, what: str = 'recordings: runs, days') -> None:
    """Add what to read and how to identify: what `report` and `plan` share with `identify`."""
    parser.add_argument('bags', nargs='+', metavar='BAG', help=what)
    options.add_channels(parser)
    parser.add_argument(
        '--day',
        metavar='PATTERN',
        help="regular expression: its first group in a bag's path is its day (else the date)",
    )
    options.add_rig(parser)
    for name, metavar, share, said in (
        ('v-c', 'V[:STD]', 0.01, 'known v_c, m/s (STD: 1 %%)'),
        ('D1', 'D[:STD]', 0.1, 'known D1 (STD: 10 %%)'),
    ):
        parser.add_argument(f'--prior-{name}', type=_prior(share), metavar=metavar, help=said)
    positive = options.number(0.0, 1e6, above=True)
    parser.add_argument('--length-scale', type=positive, metavar='M', help='d0, m (0.0485)')
    parser.add_argument(
        '--time-scale', type=positive, metavar='S', help='1/omega_psi, s (1/25.91)'
    )
    parser.add_argument(
        '--lines',
        type=_orders,
        metavar='N,...',
        help='orders of the known lines, in turns of the roller (1,2); "": none',
    )
    parser.add_argument(
        '--ignore',
        type=_interval,
        action='append',
        default=[],
        metavar='[N:]FROM:TO',
        help='leave out these s since the start of each recording, or of the Nth; repeatable',
    )
    parser.add_argument(
        '--minimum-hold', type=positive, metavar='S', help='shortest hold of the speed (8)'
    )
    parser.add_argument(
        '--frequency-range', type=_range, metavar='LOW:HIGH', help='of the hunting, Hz (0.5:20)'
    )
    length = options.number(0.0, 10.0, 'm', above=True)
    parser.add_argument(
        '--sensor-range', type=length, metavar='M', help='the lateral sensor reads no more'
    )
    parser.add_argument(
        '--clearance', type=length, metavar='M', help='amplitude at which a flange touches'
    )
    parser.add_argument(
        '--roller-diameter',
        type=length,
        metavar='M',
        help='where the roller angle was not recorded, it follows from this and the speed',
    )
    parser.add_argument(
        '--wheel-diameter', type=length, metavar='M', help="to remove the wheel's own line too"
    )
    parser.add_argument('--frequency', type=positive, metavar='HZ', help='hunting frequency')
    parser.add_argument(
        '--speed-resolution',
        type=options.number(0.0, 1e3),
        metavar='MPS',
        help='smallest step of the speed reading',
    )
    parser.add_argument(
        '--speed-scale-std',
        type=options.number(0.0, 1.0),
        metavar='SHARE',
        help='scale error of the speed reading',
    )
    parser.add_argument(
        '--bootstrap',
        type=options.whole(0, 1_000_000),
        metavar='N',
        help='intervals from N replications (0: linearised)',
    )
    options.add_seed(parser, None)
    parser.add_argument(
        '--jobs', type=options.whole(0, 4096), metavar='N', help='processes (0: one a core)'
    )
    parser.add_argument(
        '--cluster',
        metavar='ADDRESS',
        help='Dask scheduler, tcp://host:8786; its workers read the recordings by the same paths',
    )


def add_keep(parser: argparse.ArgumentParser) -> None:
    """Add where the work is kept, for verbs that need no samples of what is known."""
    parser.add_argument(
        '--work-folder',
        metavar='FOLDER',
        help='a folder of your own: what is worked out of each recording is kept there, and with'
        ' others beside it that recording is not read again',
    )


def identification_of(arguments: argparse.Namespace) -> Identification:
    """
    Identify the recordings of `add_settings`, or read what was identified before.

    A single parameter file stands for the identification beside it.

    Raises
    ------
    HuntError
        If they cannot be read, or what stands beside the file belongs to another form.
    """
    from hunt_ros.cli.support.output import progress
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.identification import Identification, identify

    if len(arguments.bags) == 1 and Path(arguments.bags[0]).suffix == '.yaml':
        path = Path(arguments.bags[0])
        text = options.read_text(path, 'parameter file')
        return Identification.load(whole_of(path), IdentifiedNormalForm.from_yaml(text, str(path)))
    settings = settings_of(arguments)
    with progress('reading') as advance:
        sources = sources_of(arguments, advance)
    with progress('identifying') as advance:
        return identify(sources, settings, advance)


def whole_of(parameter_file: Path) -> Path:
    """Return where the whole identification stands beside a parameter file."""
    return parameter_file.with_suffix('.npz')


def records_of(arguments: argparse.Namespace, advance: Advance) -> list[Record]:
    """Read the recordings, each with its day where the user says how to find it."""
    records = []
    for count, reading in enumerate(_readings(arguments), start=1):
        records.append(reading())
        advance(count / len(arguments.bags))
    return records


def sources_of(arguments: argparse.Namespace, advance: Advance) -> Sequence[Source]:
    """Return the recordings; with `--cluster` or `--work-folder` what reads those it has to."""
    later = arguments.cluster or arguments.work_folder
    return _readings(arguments) if later else records_of(arguments, advance)


@dataclass(frozen=True)
class _Reading:
    """What reads one recording, in whatever process."""

    path: str
    place: str  # the same from any folder
    channels: Mapping[str, ChannelSource]
    rig: Rig
    pattern: re.Pattern[str] | None

    def __call__(self) -> Record:
        """
        Read it.

        Raises
        ------
        HuntError
            If it cannot be read, is of another rig, or says no day.
        """
        from hunt_ros.bag import check_units, read_record

        record = read_record(self.place, self.channels, require=('lateral', 'speed'))
        record = check_units(replace(record, source=self.path))
        self.rig.refuse_other(record.notes.get('rig', ''), self.path)
        if self.pattern is None:
            return record
        found = self.pattern.search(self.path)
        if found is None:
            raise HuntError(f'--day: {self.pattern.pattern!r} is not found in {self.path}')
        return replace(record, notes={**record.notes, 'day': found.group(1)})


def _readings(arguments: argparse.Namespace) -> list[_Reading]:
    from hunt_ros.samples import CHANNELS

    channels, rig = options.channels_of(arguments, CHANNELS), options.rig_of(arguments, NODE)
    pattern = _pattern(arguments.day)
    return [
        _Reading(str(path), str(Path(path).absolute()), channels, rig, pattern)
        for path in arguments.bags
    ]


def _pattern(text: str | None) -> re.Pattern[str] | None:
    if text is None:
        return None
    try:
        pattern = re.compile(text)
    except re.error as error:
        raise HuntError(f'--day: {text!r} is no regular expression ({error})') from error
    if pattern.groups < 1:
        raise HuntError(f'--day: expected a group in parentheses, got {text!r}')
    return pattern


def settings_of(arguments: argparse.Namespace) -> IdentificationSettings:
    """Return the settings that the options of `add_settings` ask for."""
    from hunt_ros.identification import IdentificationSettings

    given = {
        'length_scale': arguments.length_scale,
        'time_scale': arguments.time_scale,
        'frequency_hz': arguments.frequency,
        'speed_resolution': arguments.speed_resolution,
        'speed_scale_std': arguments.speed_scale_std,
        'bootstrap': arguments.bootstrap,
        'seed': arguments.seed,
        'jobs': arguments.jobs,
        'cluster': arguments.cluster,
        'work_folder': getattr(arguments, 'work_folder', None),  # not of every verb
        'lines': arguments.lines,
        'roller_diameter_m': arguments.roller_diameter,
        'wheel_diameter_m': arguments.wheel_diameter,
        'ignore': tuple(arguments.ignore) or None,
        'minimum_hold_s': arguments.minimum_hold,
        'frequency_range_hz': arguments.frequency_range,
        'lateral_range_m': arguments.sensor_range,
        'flange_clearance_m': arguments.clearance,
        'prior_v_c': arguments.prior_v_c,
        'prior_D1': arguments.prior_D1,
    }
    if arguments.cluster is not None:
        _reach(arguments.cluster)
    return IdentificationSettings.of_rig(options.rig_of(arguments, NODE), **given)


def _prior(share: float) -> Callable[[str], tuple[float, float]]:
    """Return the type of VALUE or VALUE:STD; without STD it is this share of the value."""
    positive = options.number(0.0, 1e6, above=True)

    def parse(text: str) -> tuple[float, float]:
        value, colon, std = text.partition(':')
        return positive(value), positive(std) if colon else share * positive(value)

    return parse


def _interval(text: str) -> tuple[float, float, int]:
    """Read FROM:TO or N:FROM:TO."""
    words = text.split(':')
    if len(words) not in (2, 3):
        raise argparse.ArgumentTypeError(f'expected FROM:TO or N:FROM:TO, got {text}')
    number = options.whole(1)(words[0]) if len(words) == 3 else 0
    second = options.number(0.0, options.LONGEST_S, 's')
    start, end = second(words[-2]), second(words[-1])
    if not start < end:
        raise argparse.ArgumentTypeError(f'expected FROM before TO, got {text}')
    return start, end, number


def _range(text: str) -> tuple[float, float]:
    """Read LOW:HIGH."""
    low, _, high = text.partition(':')
    frequency = options.number(0.0, 1e4, 'Hz', above=True)
    found = frequency(low), frequency(high)
    if not found[0] < found[1]:
        raise argparse.ArgumentTypeError(f'expected LOW below HIGH, got {text}')
    return found


def _orders(text: str) -> tuple[float, ...]:
    """Read N,N,...; an empty text is no line."""
    order = options.number(0.0, 100.0, above=True)
    return tuple(order(word) for word in text.split(',') if word.strip())


def _reach(address: str) -> None:
    """Fail before the work begins where no Dask scheduler can be."""
    import socket

    host, _, port = address.rpartition('://')[2].rpartition(':')
    if not host or not port.isdecimal():
        raise HuntError(f'--cluster: expected tcp://HOST:PORT, got {address}')
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except (OSError, OverflowError) as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise HuntError(f'--cluster: nobody answers at {address} ({reason})') from error
