"""
What the sensor nodes and the speed node share: a driver that a thread owns.

One thread opens the driver, reads it, and opens it again when the connection is lost. Callbacks
never wait for the hardware.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any, Generic, Literal, TypeVar, cast

from rclpy.publisher import Publisher

from hunt_ros.drivers.base import DriveDriver, SensorDriver, driver_class
from hunt_ros.errors import ConfigError, DriverError, RefusedError, one_line
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.suite import Awaited

#: A read waits so long at most, s: a set point waits for it.
_READ_S = 0.05
#: A node that has decided nothing for so long leaves its device alone, s: a drive with a
#: watchdog of its own shall find out.
_UNATTENDED_S = 0.3
#: Hardware that is not there is tried again after so long, after twice as long, and so on, s.
_REOPEN_S, _REOPEN_MOST_S = 0.25, 2.0
#: A read that brings no more than this found no backlog.
_FEW = 20
#: Who has not read for so long (the process was stopped) finds a backlog, s.
_PAUSE_S = 1.0
#: Discovery is over when nobody new has come for the first time, or after the second, s.
_SETTLED_S, _SETTLE_MOST_S = 0.5, 3.0


_D = TypeVar('_D', SensorDriver, DriveDriver)


class DriverNode(SuiteNode, ABC, Generic[_D]):
    """
    A node around one driver.

    Parameters
    ----------
    name : str
        Name of the node.
    """

    #: Makes a driver that is not open yet.
    _make_driver: Callable[[], _D]
    #: What every listener has, who is waited for before the first sample.
    _announced: Publisher

    def __init__(self, name: str) -> None:
        super().__init__(name)
        #: Open; None while there is no connection. Only the thread sets it.
        self._driver: _D | None = None
        self._connecting = True  # for the first time
        self._trouble = ''  # of the connection
        self._found = False  # what it connects to has been there once
        self._heard_s = -float('inf')  # when the driver last brought a sample, steady clock
        self._settled = False  # everybody who listens has been waited for
        #: When the node last decided anything, steady clock; inf where it decides nothing.
        self._decided_s = float('inf')

    def _use_driver(self, name: str, role: Literal['Sensor', 'Drive'], *rest: Any) -> _D:
        """
        Declare the settings of a driver as parameters, and say how the driver is made; return one.

        Parameters
        ----------
        name : str
            Of its entry point: the parameter `driver`.
        role : str
            'Sensor' or 'Drive'.
        *rest : object
            What the driver gets beside its settings.

        Raises
        ------
        ConfigError
            For an unknown driver, and for settings that it refuses.
        """
        kind = driver_class(name, role)
        for item in fields(kind.Settings):
            if self.has_parameter(item.name):
                raise ConfigError(
                    f'driver {name!r}: its setting {item.name!r} has the name of a parameter of'
                    f' {self.get_name()}'
                )
        settings = declare(self, kind.Settings)
        self._make_driver = cast('Callable[[], _D]', partial(kind, settings, *rest))
        driver = self._make_driver()
        self._diagnostics.hardware = f'{name}: {driver}'
        return driver

    def begin(self) -> None:
        """Open the driver, in its thread; missing hardware is tried again and again."""
        self.work('driver', self._keep_open)

    def wake(self) -> None:
        """End a read under way."""
        if (driver := self._driver) is not None:
            self._let_go_of(driver)

    def _let_go_of(self, driver: _D) -> None:
        """Close a driver; one that fails at it is gone all the same."""
        try:
            driver.close()
        except Exception as error:  # NI tasks and USB adapters that were unplugged
            self.get_logger().warning(f'closing the driver: {one_line(error)}')

    def _keep_open(self, stopping: threading.Event) -> None:
        """Open the driver, read from it, and open it again whenever that fails."""
        wait_s = _REOPEN_S
        while not stopping.is_set():
            driver = self._make_driver()
            try:
                driver.open()
                if not self._found:  # it was only waited for: no trouble of what is there now
                    self._trouble = ''
                self._driver, self._found = driver, True
                self._read_on(driver, stopping)
            except Exception as error:  # whatever a library of the hardware raises
                if not stopping.is_set():
                    # What never answered may be starting yet; who refuses is there.
                    absent = isinstance(error, DriverError) and not isinstance(error, RefusedError)
                    self._found |= not absent
                    self._complain(one_line(error))
            finally:
                opened, self._driver = self._driver is driver, None
                self._let_go_of(driver)
            # What is there is not waited for: each time it may take a set point.
            wait_s = _REOPEN_S if opened else min(2.0 * wait_s, _REOPEN_MOST_S)
            stopping.wait(wait_s)

    def _complain(self, trouble: str) -> None:
        if self._found and not self._trouble:
            self.get_logger().error(f'{trouble}; trying again')
        self._connecting, self._trouble = False, trouble

    def _read_on(self, driver: _D, stopping: threading.Event) -> None:
        """Read until asked to stop; raises what the driver raises."""
        self._attend(driver)  # one that cannot be read may obey
        if not self._settled:
            self._settle(driver, stopping)
            self._settled = True
        self._skip_backlog(driver, stopping)
        read_s = time.monotonic()
        while not stopping.is_set():
            self._attend(driver)
            if time.monotonic() - self._decided_s > _UNATTENDED_S:
                stopping.wait(_READ_S)
                continue
            block = driver.read(_READ_S)
            before_s, read_s = read_s, time.monotonic()
            self._connecting = False
            if len(block.stamps_ns):
                self._heard_s, self._trouble = read_s, ''
            if read_s - before_s > _READ_S + _PAUSE_S:
                lost = len(block.stamps_ns) + self._skip_backlog(driver, stopping)
                read_s = time.monotonic()
                if lost:
                    self._lose(lost)
            elif len(block.stamps_ns):
                self._take(block)

    def _skip_backlog(self, driver: _D, stopping: threading.Event) -> int:
        """Throw away what was sampled while nobody read, and return how much: it is too late."""
        skipped = 0
        while not stopping.is_set():
            count = len(driver.read(1e-3).stamps_ns)
            skipped += count
            if count <= _FEW:
                break
        return skipped

    def _settle(self, driver: _D, stopping: threading.Event) -> None:
        """
        Wait until everybody who listens to the samples has been discovered.

        Listeners find a new publisher one after the other; what is published before is lost
        to some of them, and a recording would lack what the detector heard.
        """
        began = changed = time.monotonic()
        count = -1
        while (
            time.monotonic() - began < _SETTLE_MOST_S
            and time.monotonic() - changed < _SETTLED_S
            and not stopping.wait(0.02)
        ):
            self._attend(driver)
            now = self._announced.get_subscription_count()
            if now != count:
                count, changed = now, time.monotonic()

    def _link(self) -> tuple[str, str] | None:
        """Return level and text of what is wrong with the connection; None where nothing is."""
        if self._trouble:
            return 'ERROR' if self._found else Awaited('ERROR'), self._trouble
        return (Awaited('WARN'), 'connecting') if self._connecting else None

    def _attend(self, driver: _D) -> None:
        """Do what else the device needs; called by its thread before each read."""

    @abstractmethod
    def _take(self, block: Any) -> None:
        """Get a block that was read in time."""

    @abstractmethod
    def _lose(self, count: int) -> None:
        """Get the number of samples thrown away."""
