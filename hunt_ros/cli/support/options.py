"""
The options that several verbs have: one name for one thing, defined once.

A verb adds them with these functions; a value that is no sensible number is refused by its
type, before any work begins.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.errors import ConfigError

if TYPE_CHECKING:
    from hunt_ros.bag import ChannelSource
    from hunt_ros.drivers.alarm_output import AlarmOutput
    from hunt_ros.rig import Rig
    from hunt_ros.settings import Settings

#: Longest run or recording, s: ten days.
LONGEST_S = 864_000.0
#: Where recordings go.
RECORDINGS = Path('recordings')


def number(
    low: float = -math.inf, high: float = math.inf, unit: str = '', above: bool = False
) -> Callable[[str], float]:
    """
    Return the type of an option that is a finite number within limits.

    Parameters
    ----------
    low, high : float
        Limits, both included.
    unit : str
        For the message.
    above : bool
        True where `low` itself is excluded.
    """

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or not low <= value <= high or (above and value == low):
            raise argparse.ArgumentTypeError(
                f'expected {_range(low, high, unit, above)}, got {text}'
            )
        return value

    return parse


def whole(low: int = 0, high: int = 2**31 - 1) -> Callable[[str], int]:
    """Return the type of an option that is a whole number from `low` to `high`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f'expected a whole number from {low} to {high}, got {text}'
            )
        return value

    return parse


def _range(low: float, high: float, unit: str, above: bool) -> str:
    unit = f' {unit}' if unit else ''
    if math.isfinite(low) and math.isfinite(high):
        return f'a number {"above" if above else "from"} {low:g}{unit} to {high:g}{unit}'
    if math.isfinite(low):
        return f'a number {"above" if above else "of at least"} {low:g}{unit}'
    return f'a number{unit and " in"}{unit}'


def add_json(parser: argparse.ArgumentParser, what: str = 'the result') -> None:
    """`--json`: what every verb that finds something has."""
    parser.add_argument(
        '--json', type=_json_target, metavar='PATH|-', help=f"{what} as JSON; '-': stdout"
    )


def _json_target(text: str) -> str:
    return text if text == '-' else str(new_file()(text))


def new_file(*endings: str) -> Callable[[str], Path]:
    """
    Return the type of an option that names a file to write.

    Where it cannot be written is found before the work, not behind it.

    Parameters
    ----------
    endings : str
        Of the name, one of these; any without.
    """

    def parse(text: str) -> Path:
        path = Path(text)
        if not path.name or path.is_dir() or not path.absolute().parent.is_dir():
            raise argparse.ArgumentTypeError(
                f'expected a file in a folder that is there, got {text!r}'
            )
        if not os.access(path if path.exists() else path.absolute().parent, os.W_OK):
            raise argparse.ArgumentTypeError(f'{text} may not be written')
        if endings and path.suffix not in endings:
            raise argparse.ArgumentTypeError(
                f'expected a name that ends in {" or ".join(endings)}, got {text}'
            )
        return path

    return parse


def new_folder(text: str) -> Path:
    """Return the folder that a word names; it is made by who writes it."""
    if not Path(text).name:
        raise argparse.ArgumentTypeError(f'expected the name of a new folder, got {text!r}')
    return Path(text)


def refuse_place(folder: Path, what: str) -> None:
    """
    Refuse a folder that cannot be made, before the work and without making it.

    Raises
    ------
    ConfigError
        Naming it.
    """
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir() or not os.access(place, os.W_OK):
        raise ConfigError(f'{folder}: cannot write {what} there')


def add_channels(parser: argparse.ArgumentParser, what: str = '') -> None:
    """`--channel` and `--mapping`: where the channels of a recording stand."""
    parser.add_argument(
        '--channel',
        action='append',
        default=[],
        metavar='NAME=SOURCE',
        help=what or 'lateral=/daq/ch0.data[3]*0.001, or a constant: speed=16.3; repeatable',
    )
    parser.add_argument(
        '--mapping', type=Path, metavar='FILE', help='the same as YAML, a line a channel'
    )


def channels_of(
    arguments: argparse.Namespace, allowed: Iterable[str] | None
) -> dict[str, ChannelSource]:
    """
    Return where the channels stand; an option wins over a file, `--mapping` over `--rig`.

    Parameters
    ----------
    arguments : Namespace
        With the options of `add_channels` and `add_rig`.
    allowed : iterable of str or None
        Names that may occur; None for any.

    Raises
    ------
    HuntError
        Naming the file or the option.
    """
    from hunt_ros.bag import channel_map, read_channel_file

    mapping = channel_map(rig_of(arguments).sources, allowed)
    if arguments.mapping:
        mapping |= read_channel_file(arguments.mapping, allowed)
    return mapping | channel_map(arguments.channel, allowed)


def add_normal_form(parser: argparse.ArgumentParser) -> None:
    """`--normal-form`: the form that the alarm uses."""
    parser.add_argument(
        '--normal-form', type=Path, metavar='FILE', help='parameter file of hunt identify --out'
    )


def add_rig(parser: argparse._ActionsContainer) -> None:
    """`--rig`: the description of the rig, a ROS parameter file."""
    parser.add_argument(
        '--rig',
        type=Path,
        action='append',
        default=[],
        metavar='FILE',
        help='ROS parameter file that describes the rig and its nodes, as config/rig.yaml;'
        ' repeatable, a later one wins',
    )


def add_settings(
    parser: argparse.ArgumentParser, kind: type[Settings], names: Mapping[str, str]
) -> None:
    """
    Add options in place of settings; help, unit and range are those of the setting.

    Parameters
    ----------
    parser : ArgumentParser
        What is not given is None.
    kind : type of Settings
        Which settings.
    names : mapping of str to str
        Option -> setting, a number or a bool; also the name of the argument.
    """
    from dataclasses import fields

    described = {item.name: item for item in fields(kind)}
    for option, name in names.items():
        about, default = described[name].metadata, described[name].default
        help_ = about['description'].replace('%', '%%')
        if isinstance(default, bool):
            parser.add_argument(option, dest=name, action='store_true', default=None, help=help_)
            continue
        unit = about['unit']
        low, high = (
            end if about[key] is None else about[key]
            for key, end in (('low', -math.inf), ('high', math.inf))
        )
        shown = f' ({default:g})' if default else ''
        parser.add_argument(
            option,
            dest=name,
            type=number(low, high, unit),
            metavar=(unit or 'x').upper(),
            help=help_ + shown,
        )


def rig_of(arguments: argparse.Namespace, node: str = '') -> Rig:
    """
    Return the rig of `--rig`, or the usual one.

    Parameters
    ----------
    arguments : Namespace
        With the option of `add_rig`.
    node : str
        Whose own section of the files is read as well.

    Raises
    ------
    ConfigError
        Naming the file, the section and the key.
    """
    from hunt_ros.rig import Rig

    return Rig.from_texts(_rig_texts(arguments), node)


def alarm_outputs_of(arguments: argparse.Namespace) -> dict[str, AlarmOutput]:
    """
    Return the alarm outputs that the files of `--rig` name: sound, command, relay.

    Parameters
    ----------
    arguments : Namespace
        With the option of `add_rig`.

    Raises
    ------
    ConfigError
        Naming the file and the key; also for a program that is not there.
    """
    from hunt_ros.drivers.alarm_output import AlarmSettings

    return AlarmSettings.told(_rig_texts(arguments))


def _rig_texts(arguments: argparse.Namespace) -> list[tuple[str, str]]:
    from hunt_ros.rig import parameters_of

    texts = [(str(path), read_text(path, 'parameter file')) for path in arguments.rig]
    for source, text in texts:
        names = {name.partition('.')[0] for name in parameters_of('', text, source)}
        if names == {'normal_form'}:
            raise ConfigError(f'--rig {source}: is a normal form, expected --normal-form {source}')
    return texts


def add_namespace(parser: argparse._ActionsContainer, default: str | None = 'rig') -> None:
    """`--namespace`: that of the rig."""
    parser.add_argument(
        '--namespace',
        type=_namespace,
        default=default,
        help='ROS namespace of the rig (default: rig)',
    )


def _namespace(text: str) -> str:
    if not re.fullmatch(r'/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*/?', text, re.ASCII):
        raise argparse.ArgumentTypeError(f'expected a ROS name such as rig or lab/rig, got {text}')
    return text.strip('/')


def add_directory(parser: argparse._ActionsContainer, default: Path | None = RECORDINGS) -> None:
    """`--directory`: where recordings go."""
    parser.add_argument(
        '--directory',
        type=Path,
        default=default,
        metavar='DIR',
        help=f'recordings (default: {RECORDINGS})',
    )


def add_page(parser: argparse._ActionsContainer, default: str) -> None:
    """`--page`: the page of the operator; 0 stands for the port that is usual."""
    parser.add_argument(
        '--page',
        nargs='?',
        type=whole(1, 65535),
        const=0,
        metavar='PORT',
        help=f'serve the page of the operator (default port: {default}; extra dashboard)',
    )


def add_pace(
    parser: argparse._ActionsContainer, high: float, default: float | None = None
) -> None:
    """`--pace`: recorded or simulated seconds in a second."""
    parser.add_argument(
        '--pace',
        type=number(0.1, high),
        default=default,
        metavar='X',
        help=f'seconds of the rig in a second, 0.1 to {high:g} (default: {default or 1:g})',
    )


def add_rate(parser: argparse.ArgumentParser, default: float | None, what: str) -> None:
    """`--rate`: samples a second."""
    parser.add_argument(
        '--rate',
        type=number(0.0, 1e6, 'Hz', above=True),
        default=default,
        metavar='HZ',
        help=f'samples a second {what}',
    )


def add_seed(parser: argparse.ArgumentParser, default: int | None = 0) -> None:
    """`--seed`: of everything random."""
    parser.add_argument(
        '--seed', type=whole(), default=default, metavar='N', help='of everything random'
    )


def add_stretch(parser: argparse._ActionsContainer) -> None:
    """`--from` and `--to`: a part of the recording."""
    kind = number(0.0, 1e9, 's')
    since = 's since the start of the recording'
    parser.add_argument('--from', dest='start', type=kind, metavar='S', help=since)
    parser.add_argument('--to', dest='end', type=kind, metavar='S', help=since)


def check_stretch(arguments: argparse.Namespace) -> None:
    """
    Refuse a stretch that ends before it begins.

    Raises
    ------
    ConfigError
        With both ends.
    """
    start = arguments.start or 0.0
    if arguments.end is not None and arguments.end <= start:
        raise ConfigError(f'--to: expected more than --from, {start:g} s, got {arguments.end:g} s')


def read_text(path: Path, what: str) -> str:
    """
    Read a text file that a user has named.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it should be, for the message: 'normal form'.

    Raises
    ------
    ConfigError
        If it is missing, a folder, not readable, empty, or no text.
    """
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else 'not UTF-8 text'
        raise ConfigError(f'{path}: cannot read it as a {what} ({reason})') from error
    if not text.strip():
        raise ConfigError(f'{path}: cannot read it as a {what} (the file is empty)')
    return text


def make_folder(path: Path, what: str) -> Path:
    """
    Make a folder that a user has named, and be sure that it can be written to.

    Raises
    ------
    ConfigError
        If it cannot be made or written to.
    """
    from tempfile import TemporaryFile

    try:
        path.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise ConfigError(f'{path}: cannot write {what} there ({error.strerror})') from error
    return path
