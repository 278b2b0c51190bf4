"""
What an alarm does outside of the screen: a sound, a command, a relay on a Modbus coil.

None of them is a safety function. Each may fail: it then raises, and does no harm to the others.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum

from hunt_ros.drivers.modbus_link import ModbusBus, ModbusLink
from hunt_ros.errors import ConfigError, DriverError
from hunt_ros.rig import parameters_of
from hunt_ros.settings import Settings, setting, yaml_value
from hunt_ros.suite import ALARM_OUTPUTS


class Condition(Enum):
    """
    What the outputs show.

    WAITING: nothing has been heard of the detector yet. WELL: no alarm. ALARM: hunting, or an
    alarm that nobody has acknowledged. DOUBT: silence, or inputs that cannot be trusted.
    """

    WAITING = 'waiting'
    WELL = 'well'
    ALARM = 'alarm'
    DOUBT = 'doubt'

    @property
    def calls(self) -> bool:
        """True where somebody must come."""
        return self in (Condition.ALARM, Condition.DOUBT)


class AlarmOutput(ABC):
    """
    One way to call somebody.

    Parameters
    ----------
    repeat_s : float or None
        `show` is called again after so long while the condition holds; None: once.
    """

    def __init__(self, repeat_s: float | None) -> None:
        self.repeat_s = repeat_s

    @abstractmethod
    def show(self, condition: Condition, cause: str) -> None:
        """
        Show a condition.

        Raises
        ------
        DriverError
            If it cannot be shown.
        """

    @abstractmethod
    def close(self) -> None:
        """Show nothing any more; raises DriverError where that fails."""


class Command(AlarmOutput):
    """
    Runs a command at each change, with the condition and its cause as last arguments.

    Parameters
    ----------
    text : str
        As on a command line; no shell reads it.
    timeout_s : float
        It is ended after so long.

    Raises
    ------
    ConfigError
        If there is no such program.
    """

    def __init__(self, text: str, timeout_s: float) -> None:
        super().__init__(None)
        self._words, self._timeout_s = _words(text), timeout_s

    def show(self, condition: Condition, cause: str) -> None:
        """Run it; raises DriverError where it fails or takes too long."""
        _run([*self._words, condition.value, cause], self._timeout_s)

    def close(self) -> None:
        """Nothing is held."""


class Sound(AlarmOutput):
    """
    Sounds again and again while somebody must come.

    Parameters
    ----------
    text : str
        'bell', the bell of the terminal, or a command that plays a sound: 'aplay alarm.wav'.
    every_s : float
        How often.

    Raises
    ------
    ConfigError
        If there is no such program.
    """

    def __init__(self, text: str, every_s: float) -> None:
        super().__init__(every_s)
        self._words = [] if text == 'bell' else _words(text)

    def show(self, condition: Condition, cause: str) -> None:
        """Sound once; raises DriverError where that fails."""
        if not condition.calls:
            return
        if self._words:
            _run(self._words, max(10.0, self.repeat_s or 0.0))
        else:
            print('\a', end='', file=sys.stderr, flush=True)

    def close(self) -> None:
        """Nothing is held."""


class Relay(AlarmOutput):
    """
    Holds a Modbus coil on while somebody must come, written again each second.

    Parameters
    ----------
    bus : ModbusBus
        Where the relay is.
    coil : int
        Its address.
    inverted : bool
        The coil is on while all is well: a cut wire, or a node that is gone, calls too.
    """

    def __init__(self, bus: ModbusBus, coil: int, inverted: bool) -> None:
        super().__init__(1.0)
        self._bus, self._coil, self._inverted = bus, coil, inverted
        self._link: ModbusLink | None = None

    def show(self, condition: Condition, cause: str) -> None:
        """Switch it; raises DriverError where it does not answer."""
        self._write(condition is Condition.WELL if self._inverted else condition.calls)

    def close(self) -> None:
        """Switch it off."""
        try:
            self._write(False)
        finally:
            if self._link is not None:
                self._link.close()

    def _write(self, on: bool) -> None:
        link = self._link or ModbusLink(self._bus)
        try:
            if self._link is None:
                link.open()
            link.write_coil(self._coil, on)
            self._link = link
        except BaseException:
            link.close()
            self._link = None
            raise


@dataclass(frozen=True)
class AlarmSettings(Settings):
    """Who is called, and for what; the node declares its parameters from these fields."""

    sound: str = setting(
        '', "'bell' of the terminal, or a command: 'aplay alarm.wav'; empty: none.", fixed=True
    )
    sound_every_s: float = setting(
        2.0, 'How often it sounds.', unit='s', low=0.2, high=3600.0, fixed=True
    )
    command: str = setting(
        '',
        'Run at each change; last arguments: well, alarm or doubt, and the cause; empty: none.',
        fixed=True,
    )
    command_timeout_s: float = setting(
        10.0, 'The command is ended after so long.', unit='s', low=0.1, high=3600.0, fixed=True
    )
    relay_coil: int = setting(
        -1, 'Modbus coil of a relay; -1: none.', low=-1, high=65535, fixed=True
    )
    relay_inverted: bool = setting(
        False, 'The relay is on while all is well: a cut wire calls too.', fixed=True
    )
    silence_s: float = setting(
        1.0, 'No status for so long is doubt.', unit='s', low=0.2, high=3600.0, fixed=True
    )
    call_on_doubt: bool = setting(
        True, 'Call for silence and level STALE too, not only for an alarm.', fixed=True
    )

    @classmethod
    def from_texts(cls, texts: Iterable[tuple[str, str]]) -> AlarmSettings:
        """
        Read what ROS parameter files say to the node; a later one wins.

        Parameters
        ----------
        texts : iterable of (str, str)
            Where each file comes from, for messages, and what stands in it.

        Raises
        ------
        ConfigError
            Naming the file, the key and what was expected.
        """
        alarm = cls()
        known = {item.name: item.default for item in fields(cls)}
        for source, text in texts:
            told = parameters_of(ALARM_OUTPUTS, text, source)
            values = {name: yaml_value(known[name], told[name]) for name in known if name in told}
            try:
                alarm = replace(alarm, **values)
                alarm.outputs(ModbusBus())  # a program that is not there is found now
            except ConfigError as error:
                raise ConfigError(f'{source}: {ALARM_OUTPUTS}: {error}') from error
        return alarm

    @property
    def named(self) -> tuple[str, ...]:
        """The outputs that are wanted."""
        wanted = {'sound': self.sound, 'command': self.command, 'relay': self.relay_coil >= 0}
        return tuple(name for name, given in wanted.items() if given)

    def outputs(self, bus: ModbusBus) -> dict[str, AlarmOutput]:
        """
        Return the outputs that are wanted, by name; none of them acts yet.

        Parameters
        ----------
        bus : ModbusBus
            Where the relay is.

        Raises
        ------
        ConfigError
            Where there is no such program.
        """
        made: dict[str, Callable[[], AlarmOutput]] = {
            'sound': lambda: Sound(self.sound, self.sound_every_s),
            'command': lambda: Command(self.command, self.command_timeout_s),
            'relay': lambda: Relay(bus, self.relay_coil, self.relay_inverted),
        }
        return {name: made[name]() for name in self.named}


def _words(text: str) -> list[str]:
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise ConfigError(f'command {text!r}: {error}') from error
    if not words or shutil.which(words[0]) is None:
        raise ConfigError(f'command {text!r}: no program {words[0] if words else ""!r} here')
    return words


def _run(words: Sequence[str], timeout_s: float) -> None:
    try:
        done = subprocess.run(
            words, stdin=subprocess.DEVNULL, capture_output=True, timeout=timeout_s, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise DriverError(f'{words[0]}: ended after {timeout_s:g} s') from error
    except OSError as error:
        raise DriverError(f'{words[0]}: {error.strerror}') from error
    if done.returncode:
        said = ' '.join(done.stderr.decode(errors='replace').split())[-200:]
        raise DriverError(f'{words[0]}: exit code {done.returncode}{f" ({said})" if said else ""}')
