"""
The description of a rig: its channels, roller, hunting band, limits, and what is known of it.

It stands once, in the section `/**` of a ROS parameter file (`config/rig.yaml`):

    /**:
      ros__parameters:
        rig_name: rig 1
        roller_diameter_m: 0.3

Every node takes from that section the parameters that it needs, which its settings declare by
`of_rig`; every verb of the command line reads it by `--rig FILE`.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

from hunt_ros.errors import ConfigError
from hunt_ros.samples import CHANNELS, USUAL_CHANNELS
from hunt_ros.sensors import DISPLACEMENTS
from hunt_ros.settings import Settings, fixed, meant, setting, yaml_document, yaml_value
from hunt_ros.suite import NODES

_Kind = TypeVar('_Kind', bound=Settings)
_AnyRig = TypeVar('_AnyRig', bound='Rig')

#: Highest order of a known line, and how many there may be: each costs a tenth of the filter.
MOST_TURNS, MOST_LINES = 100.0, 8
#: The least hunting frequency that a rig may have, Hz.
SLOWEST_HZ = 0.05
#: The section of a parameter file that is for all nodes.
SHARED = '/**'
#: What ROS itself, and a file of `hunt identify --out`, have in that section.
_OTHERS = ('use_sim_time', 'qos_overrides', 'normal_form')

#: Unit of speeds that people read -> how many of it are 1 m/s.
SPEED_UNITS = {'m/s': 1.0, 'km/h': 3.6}

#: Where `drive_watchdog_s` is not given.
UNSTOPPED = 'the roller runs on where this machine dies: no drive_watchdog_s in the rig file'

_EITHER = ' or '.join(DISPLACEMENTS)


def _known(description: str, unit: str = '', high: float | None = None) -> Any:
    """Declare a number of the rig that a running node cannot change; 0: it is not known."""
    return setting(0.0, description, unit=unit, low=0.0, high=high, fixed=True)


@dataclass(frozen=True)
class Rig(Settings):
    """
    One rig, SI throughout.

    Raises
    ------
    ConfigError
        For a value out of range, or two that contradict each other.
    """

    rig_name: str = setting('', 'name of the rig, for its recordings')
    speed_unit: str = fixed(
        'm/s',
        'unit of speeds on page and terminal; messages, recordings and files are SI',
        choices=tuple(SPEED_UNITS),
    )
    channels: tuple[str, ...] = fixed(
        USUAL_CHANNELS,
        f'channels the rig has, of {", ".join(CHANNELS)};'
        ' one that is listed and silent is a fault',
    )
    optional_channels: tuple[str, ...] = fixed(
        (), 'of the channels, those whose silence is no fault: it is said, with what it costs'
    )
    sources: tuple[str, ...] = fixed(
        (),
        'channels that recordings have under another topic, field or unit, for example'
        ' lateral=/daq/ch0.data[3]*0.001',
    )
    constant_speed_mps: float = _known(
        'running speed where there is no speed channel (0: from the channel)', 'm/s'
    )
    lateral_range_m: float = setting(
        0.0,
        'lateral readings of this size, less a thousandth, and more are saturated (0: no limit)',
        unit='m',
        low=0.0,
    )
    yaw_range_rad: float = setting(
        0.0,
        'yaw readings of this size, less a thousandth, and more are saturated (0: no limit)',
        unit='rad',
        low=0.0,
    )
    speed_resolution_mps: float = _known(
        'smallest step of the speed reading (0: not known)', 'm/s', 100.0
    )
    speed_scale_std: float = _known(
        'relative standard deviation of the scale of the speed reading', high=1.0
    )
    roller_diameter_m: float = _known(
        'of the roller: where its lines are without a roller channel (0: as the built-in rig,'
        ' 0.3 m), and the speed checked by its angle with one (0: learnt while both move)',
        'm',
        10.0,
    )
    wheel_diameter_m: float = _known(
        'of the wheel, whose own line is known with it (0: none; needs roller_diameter_m)',
        'm',
        10.0,
    )
    lines: tuple[float, ...] = fixed(
        (1.0, 2.0),
        f'known lines, at most {MOST_LINES}, in turns of the roller from 0 to {MOST_TURNS:g}:'
        ' what is forced at these orders is no hunting (0.0: none)',
        low=0.0,
    )
    hunting_frequency_hz: float = _known(
        'nominal hunting frequency; 30 % off costs nothing, and 0.35 to 2.1 of it is followed'
        ' (0: that of the normal form, else 2.84 Hz)',
        'Hz',
        50.0,
    )
    length_scale_m: float = _known(
        'd0: the unit of amplitude of the coefficients (0: of the built-in rig)', 'm', 1e3
    )
    time_scale_s: float = _known(
        '1 / omega_psi: the unit of time of the coefficients (0: of the built-in rig)', 's', 1e3
    )
    prior_v_c: tuple[float, ...] = fixed(
        (), 'known v_c and its standard deviation, m/s (none: not known)', low=0.0
    )
    prior_D1: tuple[float, ...] = fixed(
        (), 'known D1 and its standard deviation (none: not known)', low=0.0
    )
    flange_clearance_m: float = _known(
        'lateral displacement at which the flange meets the rail (0: not known)', 'm', 1.0
    )
    speed_ceiling_mps: float = setting(
        math.inf, 'no set point is above this (.inf: no ceiling)', unit='m/s', low=0.0
    )
    safe_speed_mps: float = setting(
        math.inf,
        'where the interlock takes the roller, or safe_margin_mps below v_n of the form in force'
        ' where that is lower (.inf: there, and to a stop while no v_n is known)',
        unit='m/s',
        low=0.0,
    )
    drive_watchdog_s: float = _known(
        'the drive stops the roller by itself where nothing has been sent to it for so long'
        ' (0: it does not, or that is not known)',
        's',
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = [name for name in self.channels if name not in CHANNELS]
        if unknown:
            raise ConfigError(f'channels: unknown {unknown[0]!r}, expected some of {CHANNELS}')
        if len(set(self.channels)) < len(self.channels):
            raise ConfigError(f'channels: one is there twice in {self.channels}')
        if not set(self.channels) & set(DISPLACEMENTS):
            raise ConfigError(f'channels: need {_EITHER}, got {self.channels}')
        self._check_optional()
        self._check_lines()
        self._check_priors()
        if 0.0 < self.hunting_frequency_hz < SLOWEST_HZ:
            raise ConfigError(
                f'hunting_frequency_hz: {self.hunting_frequency_hz} is below {SLOWEST_HZ:g} Hz'
                ' (0: not given)'
            )
        if self.speed_ceiling_mps < self.safe_speed_mps < math.inf:
            raise ConfigError(
                f'safe_speed_mps: {self.safe_speed_mps:g} must not be above'
                f' speed_ceiling_mps ({self.speed_ceiling_mps:g})'
            )

    def _check_optional(self) -> None:
        """Refuse channels as optional without which nothing can be said."""
        for name in self.optional_channels:
            if name not in self.channels:
                raise ConfigError(
                    f'optional_channels: {name!r} is none of the channels {self.channels}'
                )
        if 'speed' in self.optional_channels and self.constant_speed_mps == 0.0:
            raise ConfigError(
                "optional_channels: 'speed' needs constant_speed_mps: without a speed the region"
                ' is unknown'
            )
        motion = set(DISPLACEMENTS) & set(self.channels)
        if motion <= set(self.optional_channels):
            raise ConfigError(
                f'optional_channels: {self.optional_channels} leaves no displacement,'
                f' expected {_EITHER} to be required'
            )

    def _check_lines(self) -> None:
        """Refuse orders that are none, and a wheel whose order is not known."""
        if max(self.lines, default=0.0) > MOST_TURNS or len({*self.lines} - {0.0}) > MOST_LINES:
            raise ConfigError(
                f'lines: {self.lines}, expected at most {MOST_LINES} orders of the roller, up to'
                f' {MOST_TURNS:g}'
            )
        if self.wheel_diameter_m > 0.0 and self.roller_diameter_m == 0.0:
            raise ConfigError('wheel_diameter_m: needs roller_diameter_m, got 0')

    def _check_priors(self) -> None:
        """Refuse what is no value with its standard deviation."""
        for name in ('prior_v_c', 'prior_D1'):
            given = getattr(self, name)
            if len(given) not in (0, 2) or 0.0 in given:
                raise ConfigError(
                    f'{name}: expected value and standard deviation, both positive, got {given}'
                )

    @classmethod
    def of(cls: type[_AnyRig], settings: Settings) -> _AnyRig:
        """
        Return the rig that the settings of a node tell of; the rest has its defaults.

        Raises
        ------
        ConfigError
            Where they contradict each other.
        """
        told = {item.name for item in fields(settings)}
        return cls(**{name: getattr(settings, name) for name in _FIELDS if name in told})


def refuse_other(found: str, expected: str, where: str, how: str = 'recorded') -> None:
    """
    Refuse what is of another rig.

    Parameters
    ----------
    found, expected : str
        Names of rigs; '' where none is said.
    where, how : str
        The recording or the form, and what was done to it on its rig, for the message.

    Raises
    ------
    ConfigError
        If both have a name, and not the same.
    """
    if found and expected and found != expected:
        raise ConfigError(
            f'{where}: {how} on rig {found!r}, expected {expected!r} (rig_name of the rig file)'
        )


_FIELDS = {item.name: item for item in fields(Rig)}
#: Names of the parameters of a rig.
PARAMETERS = frozenset(_FIELDS)


def of_rig(name: str) -> Any:
    """
    Declare a field of a settings class that is a parameter of the rig.

    Default, unit, range and meaning are those of `Rig`: `roller_diameter_m: float =
    of_rig('roller_diameter_m')`.
    """
    item = _FIELDS[name]
    return field(default=item.default, metadata=item.metadata)


def told_by(settings: _Kind, node: str, texts: Iterable[tuple[str, str]]) -> _Kind:
    """
    Return the settings of a node with what ROS parameter files say; a later one wins.

    Parameters
    ----------
    settings : Settings
        What holds where no file says anything.
    node : str
        Whose own section is read, beside that for all nodes; '' for this one alone.
    texts : iterable of (str, str)
        Where each file comes from, for messages, and what stands in it.

    Raises
    ------
    ConfigError
        Naming the file, the section and the key, and what was expected.
    """
    known = {item.name: item for item in fields(settings)}
    for source, text in texts:
        found = parameters_of(node, text, source)
        told = {
            name: yaml_value(known[name].default, value, known[name].metadata.get('choices') or ())
            for name, value in found.items()
            if name in known
        }
        try:
            settings = replace(settings, **told)
        except ConfigError as error:
            raise ConfigError(f'{source}: {error}') from error
    return settings


def refuse_slips(node: str, known: set[str], texts: Iterable[tuple[str, str]]) -> None:
    """Refuse what is all but one of these names; any other may be of the node itself."""
    for source, text in texts:
        for name in parameters_of(node, text, source).keys() - known - PARAMETERS:
            if near := meant(str(name), known):
                raise ConfigError(f'{source}: section {node}: unknown {name}, expected {near}')


def parameters_of(node: str, text: str, source: str) -> dict[str, Any]:
    """
    Return what a ROS parameter file says to a node, under any namespace.

    Parameters
    ----------
    node : str
        Its name; '' for the section for all nodes alone.
    text, source : str
        The parameter file, and where it comes from, for messages.

    Raises
    ------
    ConfigError
        Naming the file, the section and the key, and what was expected.
    """
    document = yaml_document(text, source)
    if not isinstance(document, Mapping) or not document:
        raise ConfigError(f'{source}: no parameter file, expected NODE: ros__parameters: ...')
    values: dict[str, Any] = {}
    for name, section in document.items():
        where, short = f'{source}: section {name}', str(name).rsplit('/', 1)[-1]
        inside = section.get('ros__parameters') if isinstance(section, Mapping) else None
        if not isinstance(inside, Mapping):
            raise ConfigError(f'{where}: expected ros__parameters: and a line a parameter')
        if name == SHARED:
            _refuse_unknown(inside, where)
        elif short not in NODES:
            near = difflib.get_close_matches(short, NODES, 1) or NODES
            raise ConfigError(f'{where}: no node of the suite, expected {" or ".join(near)}')
        if name == SHARED or short == node:
            values |= inside
    return values


def _refuse_unknown(section: Mapping[str, Any], where: str) -> None:
    """Refuse a key of the section for all nodes that is none of the rig's."""
    for name in map(str, section):
        if name in _FIELDS or name.split('.')[0] in _OTHERS:
            continue
        near = difflib.get_close_matches(name, _FIELDS, 1) or list(_FIELDS)
        unit = _FIELDS[near[0]].metadata['unit'] if len(near) == 1 else ''
        expected = ' or '.join(near) + (f', in {unit}' if unit else '')
        raise ConfigError(f'{where}: {name} is no parameter of a rig, expected {expected}')
