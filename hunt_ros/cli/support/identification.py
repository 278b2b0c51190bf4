"""What `identify`, `plan` and `report` share: options, recordings, the identification."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.errors import ConfigError, HuntError

if TYPE_CHECKING:
    from hunt_ros.bag import ChannelSource
    from hunt_ros.cli.support.output import Advance
    from hunt_ros.identification import Identification, IdentificationSettings, Source
    from hunt_ros.rig import Rig
    from hunt_ros.samples import Record

#: Whose section of a parameter file is read as well: it does the same in a running suite.
NODE = 'normal_form_identifier'
#: Option -> setting of the rig, in place of that in the files of `--rig`.
_OF_RIG = {
    '--length-scale': 'length_scale_m',
    '--time-scale': 'time_scale_s',
    '--sensor-range': 'lateral_range_m',
    '--clearance': 'flange_clearance_m',
    '--roller-diameter': 'roller_diameter_m',
    '--wheel-diameter': 'wheel_diameter_m',
    '--frequency': 'hunting_frequency_hz',
    '--speed-resolution': 'speed_resolution_mps',
    '--speed-scale-std': 'speed_scale_std',
}
#: Settings of the identification that are options by themselves.
_GIVEN = (
    'prior_v_c', 'prior_D1', 'lines', 'frequency_range_hz', 'ignore', 'minimum_hold_s',
    'seed', 'cluster',
)  # fmt: skip


def add_settings(parser: argparse.ArgumentParser, what: str = 'recordings') -> None:
    """Add what to read and how to identify: what `report` and `plan` share with `identify`."""
    from hunt_ros.rig import Rig

    parser.add_argument('bags', nargs='+', metavar='BAG', help=what)
    options.add_channels(parser)
    options.add_rig(parser)
    options.add_settings(parser, Rig, _OF_RIG)
    for name, share, what in (
        ('v-c', 0.01, 'v_c, m/s (STD: 1 %%)'),
        ('D1', 0.1, 'D1 (STD: 10 %%)'),
    ):
        parser.add_argument(
            f'--prior-{name}', type=_prior(share), metavar='X[:STD]', help=f'known {what}'
        )
    parser.add_argument(
        '--lines',
        type=_orders,
        metavar='N,...',
        help='orders of the known lines, in turns of the roller (1,2); "": none',
    )
    parser.add_argument(
        '--frequency-range',
        dest='frequency_range_hz',
        type=_range,
        metavar='LOW:HIGH',
        help='of the hunting, Hz (0.5:20)',
    )
    parser.add_argument(
        '--ignore',
        type=_interval,
        action='append',
        metavar='[N:]FROM:TO',
        help='leave out these s since the start of each recording, or of the Nth; repeatable',
    )
    parser.add_argument(
        '--minimum-hold',
        dest='minimum_hold_s',
        type=options.number(0.0, 1e6, 's', above=True),
        metavar='S',
        help='shortest hold of the speed (8)',
    )
    options.add_seed(parser, None)
    parser.add_argument(
        '--cluster',
        metavar='ADDRESS',
        help='Dask scheduler, tcp://host:8786; its workers read the recordings by the same paths',
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
        if not whole_of(path).exists():
            raise ConfigError(
                f'{path}: {whole_of(path).name}, the whole identification, is not beside it:'
                f' "hunt identify RECORDINGS --out {path}" writes both; or name the recordings'
            )
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
    """Read the recordings."""
    records = []
    for count, reading in enumerate(_readings(arguments), start=1):
        records.append(reading())
        advance(count / len(arguments.bags))
    return records


def sources_of(arguments: argparse.Namespace, advance: Advance) -> Sequence[Source]:
    """Return the recordings; with `--cluster` what reads them."""
    return _readings(arguments) if arguments.cluster else records_of(arguments, advance)


@dataclass(frozen=True)
class _Reading:
    """What reads one recording, in whatever process."""

    path: str
    place: str  # the same from any folder
    channels: Mapping[str, ChannelSource]
    rig: Rig

    def __call__(self) -> Record:
        """
        Read it.

        Raises
        ------
        HuntError
            If it cannot be read, or is of another rig.
        """
        from hunt_ros.bag import check_units, read_record

        record = read_record(self.place, self.channels, require=('lateral', 'speed'))
        record = check_units(replace(record, source=self.path))
        self.rig.refuse_other(record.notes.get('rig', ''), self.path)
        return record


def _readings(arguments: argparse.Namespace) -> list[_Reading]:
    from hunt_ros.samples import CHANNELS

    channels, rig = options.channels_of(arguments, CHANNELS), options.rig_of(arguments, NODE)
    return [
        _Reading(str(path), str(Path(path).absolute()), channels, rig) for path in arguments.bags
    ]


def settings_of(arguments: argparse.Namespace) -> IdentificationSettings:
    """Return the settings that the options of `add_settings` ask for."""
    from hunt_ros.identification import IdentificationSettings

    if arguments.cluster is not None:
        _reach(arguments.cluster)
    rig = options.rig_of(arguments, NODE)
    told = {name: getattr(arguments, name) for name in _OF_RIG.values()}
    rig = replace(rig, **{name: value for name, value in told.items() if value is not None})
    given = {name: getattr(arguments, name) for name in _GIVEN}
    given['ignore'] = tuple(arguments.ignore or ())
    return IdentificationSettings.of_rig(rig, **given)


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
