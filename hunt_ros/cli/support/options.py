"""
The options that several verbs have: one name for one thing, defined once.

A verb adds them with these functions; those that stand for a setting are declared from it. A
value that is no sensible number is refused by its type, before any work begins.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, TypeVar

from hunt_ros.errors import ConfigError, HuntError
from hunt_ros.files import read_text
from hunt_ros.settings import Settings
from hunt_ros.suite import DRIVE

if TYPE_CHECKING:
    from hunt_ros.bag import ChannelSource
    from hunt_ros.rig import Rig

_Kind = TypeVar('_Kind', bound=Settings)
_Kinds: TypeAlias = tuple[type[Settings], ...]

#: Longest run or recording, s: ten days.
LONGEST_S = 864_000.0
#: No setting of a rig is larger, in its unit.
_BIG = 1e9
#: Where recordings go.
RECORDINGS = Path('recordings')


def number(
    low: float,
    high: float,
    unit: str = '',
    above: bool = False,
    kind: type[float] = float,
) -> Callable[[str], Any]:
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
    kind : type
        `int` for a whole number.
    """
    form, what = ('d', 'whole number') if kind is int else ('g', 'number')
    limits = f'{"above" if above else "from"} {low:{form}} to {high:{form}} {unit}'.rstrip()

    def parse(text: str) -> float:
        """Return the value of a text, or refuse it."""
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or not low <= value <= high or (above and value == low):
            raise argparse.ArgumentTypeError(f'expected a {what} {limits}, got {text}')
        return value

    return parse


def numbers(
    kind: Callable[[str], float], sign: str = ',', form: str = ''
) -> Callable[[str], tuple[float, ...]]:
    """
    Return the type of an option that is numbers between signs.

    `form`, such as T:SIZE, says what they are, and how many.
    """

    def parse(text: str) -> tuple[float, ...]:
        """Return the value of a text, or refuse it."""
        parts = text.split(sign)
        if form and len(parts) != len(form.split(sign)):
            raise argparse.ArgumentTypeError(f'expected {form}, got {text}')
        return tuple(map(kind, parts))

    return parse


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
        """Return the value of a text, or refuse it."""
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
    """Return the folder that a word names, which is not there yet: who writes it makes it."""
    path = Path(text)
    if not path.name or path.exists():
        why = ', which exists already' if path.name else ''
        raise argparse.ArgumentTypeError(f'expected the name of a new folder, got {text!r}{why}')
    refuse_place(path, 'the recording')
    return path


def _rig_file(text: str) -> Path:
    if (path := Path(text)).is_fifo():  # it is read several times, also by the nodes
        raise argparse.ArgumentTypeError(f'expected a file, got a pipe, {text}')
    return path


def _json_target(text: str) -> str:
    return text if text == '-' else str(new_file()(text))


def _namespace(text: str) -> str:
    if not re.fullmatch(r'/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*/?', text, re.ASCII):
        raise argparse.ArgumentTypeError(f'expected a ROS name such as rig or lab/rig, got {text}')
    return text.strip('/')


#: An option that takes no value; None where it is not given.
FLAG: dict[str, Any] = {'action': 'store_true', 'default': None}
#: The options that several verbs have.
OPTIONS: dict[str, dict[str, Any]] = {
    '--json': {
        'type': _json_target, 'metavar': 'PATH|-', 'help': "the result as JSON; '-': stdout",
    },
    '--rig': {
        'type': _rig_file, 'action': 'append', 'default': [], 'metavar': 'FILE',
        'help': 'ROS parameter file that describes the rig and its nodes, as config/rig.yaml;'
        ' repeatable, a later one wins',
    },
    '--channel': {
        'action': 'append', 'default': [], 'metavar': 'NAME=SOURCE',
        'help': 'lateral=/daq/ch0.data[3]*0.001, or a constant: speed=16.3; repeatable',
    },
    '--normal-form': {
        'type': Path, 'metavar': 'FILE', 'help': 'parameter file of hunt identify --out',
    },
    '--namespace': {'type': _namespace, 'help': 'ROS namespace of the rig (default: rig)'},
    '--directory': {
        'type': Path, 'metavar': 'DIR',
        'help': f'recordings (default: as in the rig file, else {RECORDINGS})',
    },
    '--page': {
        'type': number(1, 65535, kind=int), 'nargs': '?', 'const': 0, 'metavar': 'PORT',
        'help': 'serve the page of the operator (extra dashboard)',
    },
    '--pace': {'metavar': 'X', 'help': 'seconds of the rig in a second, from 0.1 (%(default)s)'},
    '--rate': {
        'type': number(0.0, 1e6, 'Hz', above=True), 'metavar': 'HZ', 'help': 'samples a second',
    },
    '--seed': {
        'type': number(0, 2**31 - 1, kind=int), 'metavar': 'N', 'help': 'of everything random',
    },
    '--from': {
        'dest': 'start', 'type': number(0.0, 1e9, 's'), 'metavar': 'S',
        'help': 's since the start of the recording',
    },
    '--to': {
        'dest': 'end', 'type': number(0.0, 1e9, 's'), 'metavar': 'S',
        'help': 's since the start of the recording',
    },
}  # fmt: skip


def add(parser: argparse._ActionsContainer, *names: str, **other: Any) -> None:
    """Add arguments: of the table, with what is other in this verb, or of this verb alone."""
    for name in names:
        parser.add_argument(name, **(OPTIONS.get(name, {}) | other))


class Parser(argparse.ArgumentParser):
    """An argument parser that knows the options of several verbs, and complains in one line."""

    def __init__(self, **options: Any) -> None:
        # An abbreviation would mean another option as soon as one with its letters is added.
        super().__init__(allow_abbrev=False, **options)

    def add(self, *names: str, **other: Any) -> None:
        """Add arguments, as the function `add` does."""
        add(self, *names, **other)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refuse a word that nothing takes in the name of the verb, not of all verbs."""
        found, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(f'unrecognized arguments: {" ".join(rest)}')
        return found, rest

    def error(self, message: str) -> NoReturn:
        """Refuse the command line in one line."""
        raise HuntError(f'{message} (see {self.prog} --help)')


def place_of(folder: Path) -> Path:
    """Return the folder, or where it would be made: the nearest one that is there."""
    return next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())


def refuse_place(folder: Path, what: str) -> None:
    """
    Refuse a folder that cannot be made, before the work and without making it.

    Raises
    ------
    HuntError
        Naming it.
    """
    place = place_of(folder)
    if not place.is_dir() or not os.access(place, os.W_OK):
        raise HuntError(f'{folder}: cannot write {what} there')


def channels_of(
    arguments: argparse.Namespace, allowed: Iterable[str] | None
) -> dict[str, ChannelSource]:
    """
    Return where the channels stand; an option wins over a file.

    Parameters
    ----------
    arguments : Namespace
        With the options `--channel` and `--rig`.
    allowed : iterable of str or None
        Names that may occur; None for any.

    Raises
    ------
    HuntError
        Naming the file or the option.
    """
    from hunt_ros.bag import channel_map

    told = channel_map(rig_of(arguments).sources, allowed)
    return told | channel_map(arguments.channel, allowed)


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
        Option -> setting; also the name of the argument.
    """
    described = {item.name: item for item in fields(kind)}
    for option, name in names.items():
        about, default = described[name].metadata, described[name].default
        unit = about['unit']
        one = number(about['low'] or 0.0, about['high'] or _BIG, unit)
        how: dict[str, Any] = {'type': one, 'metavar': (unit or 'x').upper()}
        if isinstance(default, tuple):
            how = {'type': numbers(one), 'metavar': 'X,...'}
        elif isinstance(default, bool):
            how = FLAG
        usual = f' ({default:g})' if default else ''
        described_as = about['description'].replace('%', '%%') + usual
        parser.add_argument(option, dest=name, **how, help=described_as)


def given_settings(arguments: argparse.Namespace, names: Iterable[str]) -> dict[str, Any]:
    """Return the settings that were given as options, by name."""
    return {name: x for name in names if (x := getattr(arguments, name)) is not None}


def add_set(
    parser: argparse.ArgumentParser, example: str, short: Mapping[str, str], **nodes: _Kinds
) -> None:
    """
    Add `--set NAME=VALUE`, the value as YAML, which wins over that in the files of `--rig`.

    Parameters
    ----------
    parser : ArgumentParser
        `set` is a list of (section of a parameter file, name, value).
    example : str
        For the help.
    short : mapping of str to str
        Option -> setting that it gives as well; a list between commas or colons.
    **nodes : tuple of types of Settings
        Node -> those of it that may be given. What the rig has too is meant for every node.
    """
    from hunt_ros.rig import PARAMETERS, SHARED

    known = {
        item.name: (node, item)
        for node, kinds in nodes.items()
        for kind in kinds
        for item in fields(kind)
        if item.metadata
    }

    def parse(word: str) -> tuple[str, str, str]:
        """Return the parts of a word, or refuse it."""
        name, equals, value = word.partition('=')
        if not equals or name not in known:
            expected = f'expected NAME=VALUE with one of {", ".join(sorted(known))}'
            raise argparse.ArgumentTypeError(f'{word}: {expected}')
        node, item = known[name]
        if not value.strip():  # lines= is a list without a line
            value = '[]' if isinstance(item.default, tuple) else "''"
        return SHARED if name in PARAMETERS else node, name, value

    def valued(name: str) -> Callable[[str], tuple[str, str, str]]:
        """Return the type of an option that stands for a setting."""
        if isinstance(known[name][1].default, tuple):
            return lambda text: parse(f'{name}=[{text.replace(":", ",")}]')
        return lambda text: parse(f'{name}={text}')

    what = f'a setting, in place of that in the rig file: {example}; repeatable'
    given: dict[str, Any] = {'action': 'append', 'default': []}
    add(parser, '--set', type=parse, metavar='NAME=VALUE', help=what, **given)
    for option, name in short.items():
        kind = valued(name)
        add(parser, option, dest='set', type=kind, metavar='X', help=f'--set {name}=X', **given)


def settings_of(arguments: argparse.Namespace, node: str, *kinds: type[_Kind]) -> list[_Kind]:
    """
    Build the settings of a node the way ROS would: from the files of `--rig`, and `--set`.

    Parameters
    ----------
    arguments : Namespace
        `rig`, and perhaps `set`.
    node : str
        Its name: the sections of the files that are taken.
    *kinds : type of Settings
        Those of the node.

    Raises
    ------
    ConfigError
        Naming the file or word, and what was expected.
    """
    from hunt_ros.rig import refuse_slips, told_by

    texts = rig_texts(arguments)
    known = {item.name for kind in kinds for item in fields(kind)}
    refuse_slips(node, known, texts)
    return [told_by(kind(), node, texts) for kind in kinds]


def rig_of(arguments: argparse.Namespace, node: str = '') -> Rig:
    """
    Return the rig of `--rig`, or the usual one.

    Parameters
    ----------
    arguments : Namespace
        With the option `--rig`.
    node : str
        Whose own section of the files is read as well.

    Raises
    ------
    ConfigError
        Naming the file, the section and the key.
    """
    from hunt_ros.rig import Rig, told_by

    return told_by(Rig(), node, rig_texts(arguments))


def refuse_drivers(arguments: argparse.Namespace, nodes: Collection[str]) -> None:
    """Refuse a driver that is not there: `--rig` names it for one of these nodes."""
    from hunt_ros.drivers.base import driver_class
    from hunt_ros.rig import parameters_of

    for source, text in rig_texts(arguments):
        for node in nodes:
            if driver := parameters_of(node, text, source).get('driver'):
                driver_class(str(driver), 'Drive' if node == DRIVE else 'Sensor')


def rig_texts(arguments: argparse.Namespace) -> list[tuple[str, str]]:
    """
    Read the files of `--rig`: where each comes from, and what stands in it; then `--set`.

    Raises
    ------
    ConfigError
        If one cannot be read, or is a normal form.
    """
    from hunt_ros.rig import parameters_of

    texts = [(str(path), read_text(path, 'parameter file')) for path in arguments.rig]
    for source, text in texts:
        names = {name.partition('.')[0] for name in parameters_of('', text, source)}
        if names == {'normal_form'}:
            raise ConfigError(f'--rig {source}: is a normal form, expected --normal-form {source}')
    given: dict[str, dict[str, str]] = {}  # all together: one may need another
    for section, name, value in getattr(arguments, 'set', ()):
        given.setdefault(section, {})[name] = value
    for section, words in given.items():
        inside = ', '.join(f'{name}: {value}' for name, value in words.items())
        texts.append(('--set', f'{section}: {{ros__parameters: {{{inside}}}}}'))
    return texts


def recordings_of(arguments: argparse.Namespace) -> Path:
    """Return where recordings go: as `--directory` says, else as the rig file does."""
    from hunt_ros.rig import parameters_of

    folder = RECORDINGS
    for source, text in rig_texts(arguments):
        folder = Path(str(parameters_of('bag_recorder', text, source).get('directory', folder)))
    return arguments.directory or folder


def refuse_given(arguments: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """Refuse options that would have no effect."""
    for name in names:
        if getattr(arguments, OPTIONS.get(name, {}).get('dest', name.strip('-'))) is not None:
            raise ConfigError(f'{name}: {why}')


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
