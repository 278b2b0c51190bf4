"""
What the sensor nodes and the speed node share: a driver that is read in a thread.

The lifecycle opens and closes the driver; a lost connection is opened again.
"""

from __future__ import annotations

import threading
import time

from rclpy.lifecycle import LifecycleNode, State, TransitionCallbackReturn
from rclpy.publisher import Publisher

from hunt_ros.drivers.base import DriveDriver, SensorDriver
from hunt_ros.errors import DriverError, HuntError
from hunt_ros.nodes.runtime import settle

READ_S = 0.2
_REOPEN_S = 1.0
#: A read that brings no more than this found no backlog.
_FEW = 20


class DriverNode(LifecycleNode):
    """
    A lifecycle node around one driver.

    A node of this kind has `_make_driver()`, which returns the driver, and
    `_publish_block()`, which reads once, for at most `READ_S`, and publishes.

    Parameters
    ----------
    name : str
        Name of the node.
    """

    #: A publisher whose listeners are waited for before the first sample.
    _announced: Publisher

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.failure = ''
        self._driver: SensorDriver | DriveDriver | None = None
        self._thread: threading.Thread | None = None
        self._active = threading.Event()
        self._trouble = ''

    def on_configure(self, state: State) -> TransitionCallbackReturn:
        """Open the driver."""
        self._driver = self._make_driver()
        try:
            self._driver.open()
        except HuntError as error:
            self.failure = str(error)
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        """Publish from now on."""
        self._active.set()
        self._thread = threading.Thread(target=self._work, name='driver', daemon=True)
        self._thread.start()
        return super().on_activate(state)

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        """Stop publishing; the driver stays open."""
        self._end_thread()
        return super().on_deactivate(state)

    def on_cleanup(self, state: State) -> TransitionCallbackReturn:
        """Close the driver."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: State) -> TransitionCallbackReturn:
        """Close the driver."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Stop the thread and let go of the hardware."""
        self._end_thread()
        if self._driver is not None:
            self._driver.close()
            self._driver = None

    def _end_thread(self) -> None:
        self._active.clear()
        if self._thread is not None:
            self._thread.join(timeout=2.0)
            self._thread = None

    def _work(self) -> None:
        """Read and publish until deactivated; a lost connection is opened again."""
        settle(self._announced)
        self._discard_backlog()
        while self._active.is_set():
            try:
                self._publish_block()
                self._trouble = ''
            except DriverError as error:
                if self._active.is_set():
                    self._reopen(error)

    def _discard_backlog(self) -> None:
        """Throw away what was sampled while nobody asked: it would come too late."""
        try:
            while self._active.is_set() and len(self._driver.read(1e-3).stamps_ns) > _FEW:
                pass
        except DriverError:
            pass  # met again, and told, by the first read

    def _reopen(self, error: DriverError) -> None:
        if not self._trouble:
            self.get_logger().error(f'{error}; trying again every {_REOPEN_S:g} s')
        self._trouble = str(error)
        self._driver.close()
        time.sleep(_REOPEN_S)
        try:
            self._driver = self._make_driver()
            self._driver.open()
        except DriverError as again:
            self._trouble = str(again)
