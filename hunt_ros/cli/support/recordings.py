"""What `identify`, `plan` and `report` share: options, recordings, the identification."""

from __future__ import annotations

import argparse
import socket
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from hunt_ros.bag import ChannelSource, check_units, read_record
from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import progress
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import ConfigError, HuntError
from hunt_ros.identification import Identification, IdentificationSettings, Source, identify
from hunt_ros.rig import refuse_other
from hunt_ros.samples import CHANNELS, Record
from hunt_ros.settings import Settings

#: Whose section of a parameter file is read as well: it does the same in a running suite.
_NODE = 'normal_form_identifier'
#: Option -> setting of the rig that it gives, as `--set` does.
_SHORT = {
    '--length-scale': 'length_scale_m',
    '--time-scale': 'time_scale_s',
    '--prior-v-c': 'prior_v_c',
    '--prior-D1': 'prior_D1',
}


def add_recordings(
    parser: options.Parser, what: str = 'recordings', **nodes: tuple[type[Settings], ...]
) -> None:
    """Add what to read and how to identify; `--set` takes the settings of these nodes too."""
    parser.add('bags', nargs='+', metavar='BAG', help=what)
    parser.add('--channel', '--rig', '--seed')
    example = 'roller_diameter_m=0.3, lines=[], prior_v_c=[8.0,0.05]'
    options.add_set(parser, example, _SHORT, **{_NODE: (IdentificationSettings,)}, **nodes)
    left = 'leave out these s since the start of each recording, or of the Nth; repeatable'
    parser.add('--ignore', type=_interval, action='append', metavar='[N:]FROM:TO', help=left)
    where = 'Dask scheduler, tcp://host:8786; its workers read the recordings by the same paths'
    parser.add('--cluster', metavar='ADDRESS', help=where)


def _interval(text: str) -> tuple[float, float, int]:
    """Read FROM:TO or N:FROM:TO."""
    *number, start, end = options.numbers(options.number(0.0, options.LONGEST_S), ':')(f'0:{text}')
    if len(number) not in (1, 2) or number[-1] % 1.0 or not start < end:
        raise argparse.ArgumentTypeError(f'expected FROM:TO or N:FROM:TO, FROM first, got {text}')
    return start, end, int(number[-1])


def settings_of(arguments: argparse.Namespace) -> IdentificationSettings:
    """Return the settings that the options of `add_recordings` ask for."""
    if arguments.cluster is not None:
        _reach(arguments.cluster)
    (settings,) = options.settings_of(arguments, _NODE, IdentificationSettings)
    given = options.given_settings(arguments, ('seed', 'cluster'))
    return replace(settings, ignore=tuple(arguments.ignore or ()), **given)


def _reach(address: str) -> None:
    """Fail before the work begins where no Dask scheduler can be."""
    host, _, port = address.rpartition('://')[2].rpartition(':')
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except (OSError, OverflowError, ValueError) as error:
        raise HuntError(
            f'--cluster: nobody answers at {address}, expected tcp://HOST:PORT ({error})'
        ) from error


def identified(
    arguments: argparse.Namespace, here: bool = False
) -> tuple[list[Source], Identification]:
    """
    Identify the recordings; with `--cluster` its workers read them.

    Parameters
    ----------
    arguments : Namespace
        With the options of `add_recordings`.
    here : bool
        Read them in this process all the same.

    Returns
    -------
    list of Record, or of what reads one where `--cluster` does
    Identification

    Raises
    ------
    HuntError
        If they cannot be read.
    """
    settings, sources = settings_of(arguments), _readings(arguments)
    with progress('reading') as advance:
        given: list[Source] = [*sources] if arguments.cluster and not here else []
        for reading in sources[len(given) :]:
            given.append(reading())
            advance(len(given) / len(sources))
    with progress('identifying') as advance:
        return given, identify(given, settings, advance)


def known_of(arguments: argparse.Namespace) -> Identification:
    """
    Identify the recordings, or read what was identified before.

    A single parameter file stands for the identification beside it.

    Raises
    ------
    HuntError
        If they cannot be read, or what stands beside the file belongs to another form.
    """
    path = Path(arguments.bags[0])
    if len(arguments.bags) > 1 or path.suffix != '.yaml':
        return identified(arguments)[1]
    form = IdentifiedNormalForm.read(path)
    if not whole_of(path).exists():
        raise ConfigError(
            f'{path}: {whole_of(path).name}, the whole identification, is not beside it:'
            f' "hunt identify RECORDINGS --out {path}" writes both; or name the recordings'
        )
    return Identification.load(whole_of(path), form)


def whole_of(parameter_file: Path) -> Path:
    """Return where the whole identification stands beside a parameter file."""
    return parameter_file.with_suffix('.npz')


def _read(path: str, place: str, channels: Mapping[str, ChannelSource], rig_name: str) -> Record:
    """Read one recording, in whatever process; `place` is the same from any folder."""
    record = read_record(place, channels, require=('lateral', 'speed'))
    record = check_units(replace(record, source=path))
    refuse_other(record.notes.get('rig', ''), rig_name, path)
    return record


def _readings(arguments: argparse.Namespace) -> list[partial[Record]]:
    channels = options.channels_of(arguments, CHANNELS)
    rig_name = options.rig_of(arguments, _NODE).rig_name
    return [
        partial(_read, str(path), str(Path(path).absolute()), channels, rig_name)
        for path in arguments.bags
    ]
