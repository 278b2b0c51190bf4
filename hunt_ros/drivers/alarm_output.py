"""
What an alarm does outside of the screen, and when: a sound, a command, a relay on a Modbus coil.

None of them is a safety function. Each may fail: it then raises, and does no harm to the others.
"""

from __future__ import annotations

import math
import shlex
import shutil
import subprocess
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, fields
from enum import Enum

from hunt_ros.drivers.alarms import OUT_OF_SERVICE
from hunt_ros.drivers.interlock import BLIND
from hunt_ros.drivers.modbus import ModbusBus, ModbusLink
from hunt_ros.errors import ConfigError, DriverError
from hunt_ros.rig import refuse_slips, told_by
from hunt_ros.settings import setting
from hunt_ros.suite import ALARM_OUTPUTS, START_S


class Condition(Enum):
    """
    What the outputs show.

    WAITING: the suite is starting. WELL: no alarm. ALARM: hunting, or an alarm that nobody has
    acknowledged. DOUBT: silence, or inputs that cannot be trusted.
    """

    WAITING = 'waiting'
    WELL = 'well'
    ALARM = 'alarm'
    DOUBT = 'doubt'

    @property
    def calls(self) -> bool:
        """True where somebody must come."""
        return self in (Condition.ALARM, Condition.DOUBT)


#: What sounds again after an acknowledgement: the events with which an alarm begins.
_BEGINS = ('escaping', 'limit_cycle', 'limit_exceeded', 'interlock_tripped')


class Call:
    """
    What the outputs show, by what detector and speed node say; moments are of a steady clock, s.

    Parameters
    ----------
    silence_s : float
        A detector that says nothing for so long is a doubt.
    began_s : float
        Of the start.

    Attributes
    ----------
    condition, cause : Condition, str
        At the last look.
    acknowledged : bool
        A person has acknowledged it.
    """

    def __init__(self, silence_s: float, began_s: float) -> None:
        self.condition, self.cause = Condition.WAITING, 'no status heard yet'
        self.acknowledged = False
        self._silence_s, self._began_s = silence_s, began_s
        self._heard_s = self._drive_s = -math.inf
        self._status: Mapping[str, str] = {}
        self._kept = ''  # what the speed node keeps until a person ends it
        self._out: set[str] = set()  # codes of what calls nobody in the operating state
        self._judged = False  # the detector has had sound inputs once
        #: The speed node was asked to end, while nothing was in doubt: its silence is none.
        self._ending = False

    def hear(self, now_s: float, status: Mapping[str, str]) -> None:
        """Take a status of the detector."""
        self._status, self._heard_s = status, now_s
        self._judged |= status['level'] != 'STALE'

    def hear_drive(self, now_s: float, said: Mapping[str, str]) -> None:
        """Take what the speed node says: of an alarm that outlived its detector, and of a trip."""
        doubted = not self._ending and self.condition is Condition.DOUBT
        self._drive_s, self._ending = now_s, said.get('ending') == 'True' and not doubted
        # The detector may end before it, which is no news; what tripped it before is.
        expected = self._ending and said.get('interlock_code') in BLIND and not self._kept
        tripped = said.get('interlock_state') == 'tripped' and not expected
        cause = said.get('interlock_cause', 'it has tripped') if tripped else ''
        self._out = OUT_OF_SERVICE.get(said.get('operating_state', ''), set())
        self._kept = said.get('alarm_kept') or cause

    def hear_event(self, event: str) -> None:
        """Silence the horn for what was acknowledged; an alarm that follows sounds again."""
        if event in ('acknowledged', *_BEGINS):
            self.acknowledged = event == 'acknowledged'

    def heard(self, now_s: float) -> bool:
        """Return True while the detector speaks."""
        return now_s - self._heard_s <= self._silence_s

    def look(self, now_s: float) -> bool:
        """Judge anew; return True where the condition is another one."""
        before = self.condition
        self.condition, cause = self._judge(now_s)
        if self.condition is before:
            return False
        self.cause, self.acknowledged = cause, False
        return True

    def _judge(self, now_s: float) -> tuple[Condition, str]:
        """Return what is to be shown, and why: what was an alarm is one while it is silent."""
        status = self._status
        words = f'{status["level"]}: {status["message"]}' if status else 'no status heard yet'
        causes = {*status.get('causes', '').split()}
        # Of a speed node that is gone nobody knows the state, unless it was asked to end.
        ending = self._ending and now_s - self._drive_s < START_S
        known = ending or now_s - self._drive_s < self._silence_s
        out = known and bool(causes) and causes <= self._out
        if self._kept:
            return Condition.ALARM, self._kept
        alarm = bool(status) and (status['level'] == 'ERROR' or status.get('alarm') == 'True')
        if alarm and not out:
            return Condition.ALARM, words
        if not self._judged and now_s - self._began_s < START_S:
            return Condition.WAITING, words
        if not status:
            return Condition.DOUBT, f'no status since the start, for more than {START_S:g} s'
        if ending:
            return Condition.WELL, f'the run is being ended: {words}'
        if not self.heard(now_s):
            return Condition.DOUBT, f'no status for {self._silence_s:g} s'
        if out:  # a detector that is silent calls all the same
            return Condition.WELL, f'out of service: {words}'
        return Condition.DOUBT if status['level'] == 'STALE' else Condition.WELL, words


class AlarmOutput(ABC):
    """One way to call somebody."""

    #: `show` is called again after so long while the condition holds; None: once.
    repeat_s: float | None = None
    #: It is silent once somebody has acknowledged what it calls for.
    horn = False

    @abstractmethod
    def show(self, condition: Condition, cause: str) -> None:
        """
        Show a condition.

        Raises
        ------
        DriverError
            If it cannot be shown.
        """

    def close(self) -> None:  # noqa: B027 - most hold nothing
        """Show nothing any more; raises DriverError where that fails."""


class Command(AlarmOutput):
    """
    Runs a command at each change, with the condition and its cause as last arguments.

    Parameters
    ----------
    text : str
        As on a command line; no shell reads it.

    Raises
    ------
    ConfigError
        If there is no such program.
    """

    #: It is ended after so long.
    longest_s = 10.0

    def __init__(self, text: str) -> None:
        try:
            self._words = shlex.split(text)
        except ValueError as error:
            raise ConfigError(f'command {text!r}: {error}') from error
        program = self._words[0] if self._words else ''
        if shutil.which(program) is None:
            raise ConfigError(f'command {text!r}: no program {program!r} here')

    def show(self, condition: Condition, cause: str) -> None:
        """Run it; raises DriverError where it fails or takes too long."""
        if condition is not Condition.WAITING:
            self._run(condition.value, cause)

    def _run(self, *arguments: str) -> None:
        name, words, longest_s = self._words[0], [*self._words, *arguments], self.longest_s
        try:
            null = subprocess.DEVNULL
            done = subprocess.run(words, stdin=null, capture_output=True, timeout=longest_s)
        except subprocess.TimeoutExpired as error:
            raise DriverError(f'{name}: ended after {longest_s:g} s') from error
        except OSError as error:
            raise DriverError(f'{name}: {error.strerror}') from error
        if done.returncode:
            said = ' '.join(done.stderr.decode(errors='replace').split())[-200:]
            raise DriverError(f'{name}: exit code {done.returncode}{f" ({said})" if said else ""}')


class Sound(Command):
    """Sounds again and again while somebody must come: its command plays a sound."""

    repeat_s = 2.0
    longest_s = 120.0
    horn = True

    def show(self, condition: Condition, cause: str) -> None:
        """Sound once; raises DriverError where that fails."""
        if condition.calls:
            self._run()


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

    repeat_s = 1.0

    def __init__(self, bus: ModbusBus, coil: int, inverted: bool) -> None:
        self._bus, self._coil, self._inverted = bus, coil, inverted
        self._line = threading.Lock()

    def show(self, condition: Condition, cause: str) -> None:
        """Switch it; raises DriverError where it does not answer."""
        waiting = condition is Condition.WAITING
        if self._inverted:  # whoever wrote "all is well" before may have been killed
            self._write(not (waiting or condition.calls))
        elif not waiting:  # nor is an alarm of before taken back
            self._write(condition.calls)

    def close(self) -> None:
        """Switch it off."""
        self._write(False)

    def _write(self, on: bool) -> None:
        """Have the line for this moment only: others may share it."""
        link = ModbusLink(self._bus)
        with self._line, closing(link):
            link.open()
            link.write_coil(self._coil, on)


@dataclass(frozen=True)
class AlarmSettings(ModbusBus):
    """Who is called, and for what, and the bus of the relay; parameters of the node."""

    sound: str = setting('', "A command that plays a sound: 'aplay alarm.wav'; empty: none.")
    command: str = setting(
        '', 'Run at each change; last arguments: well, alarm or doubt, and the cause; empty: none.'
    )
    relay_coil: int = setting(-1, 'Modbus coil of a relay; -1: none.', low=-1, high=65535)
    relay_inverted: bool = setting(
        False, 'The relay is on while all is well: a cut wire calls too.'
    )
    silence_s: float = setting(
        1.0, 'No status for so long is doubt.', unit='s', low=0.2, high=3600.0
    )
    tested_file: str = setting('', 'File whose age is that of the last test-alarm; empty: none.')

    @staticmethod
    def told(texts: Iterable[tuple[str, str]]) -> dict[str, AlarmOutput]:
        """
        Return the outputs that ROS parameter files name; none of them acts yet.

        Parameters
        ----------
        texts : iterable of (str, str)
            Where each file comes from, for messages, and what stands in it; a later one wins.

        Raises
        ------
        ConfigError
            Naming the file, the key and what was expected; also for a program that is not there.
        """
        known = list(texts)
        settings = told_by(AlarmSettings(), ALARM_OUTPUTS, known)
        # Without an output no node is started, which would do it.
        refuse_slips(ALARM_OUTPUTS, {item.name for item in fields(settings)}, known)
        try:
            return settings.outputs()
        except ConfigError as error:
            sources = ', '.join(source for source, _ in known)
            raise ConfigError(f'{sources}: {ALARM_OUTPUTS}: {error}') from error

    def outputs(self) -> dict[str, AlarmOutput]:
        """
        Return the outputs that are wanted, by name; none of them acts yet.

        Raises
        ------
        ConfigError
            Where there is no such program.
        """
        outputs: dict[str, AlarmOutput] = {}
        if self.sound:
            outputs['sound'] = Sound(self.sound)
        if self.command:
            outputs['command'] = Command(self.command)
        if self.relay_coil >= 0:
            outputs['relay'] = Relay(self, self.relay_coil, self.relay_inverted)
        return outputs
