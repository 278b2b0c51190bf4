"""
What every node of the suite is: alone of its name, heard at its own pace, and ended in order.

An executor has an event for every message. At some thousand messages a second that is most of
what a node does, and on a machine that cannot keep up the events queue without a bound: a call
of a service, which has its place behind them, is never answered. A polled subscription, which
`hearing.waiting` empties, costs half as much a message, and leaves the executor free.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from threading import Event
from typing import Any, cast

from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from std_msgs.msg import String

from hunt_ros.errors import ConfigError
from hunt_ros.nodes.support.diagnostics import Diagnostics, Health, steady_clock
from hunt_ros.nodes.support.ending import CLOSING_S
from hunt_ros.nodes.support.parameters import parameter_file
from hunt_ros.nodes.support.qos import announce
from hunt_ros.nodes.support.worker import Worker, hidden_node
from hunt_ros.suite import hold

_FIXED = 'use_sim_time: taken at the start only'
#: Parameters, which each node tells for recordings, are looked at so often, s.
_LOOK_S = 1.0
#: A thread beside it looks so often whether it is to end, s.
_ASKED_S = 0.1


class SuiteNode(Node):
    """
    A node that `runtime.run` runs. To stand first in the bases.

    Parameters
    ----------
    name : str
        Of the node.
    alone : bool
        A second one of its full name, on this machine and in this ROS domain, refuses to start,
        and its health and its parameters are told. False for what only asks.
    **keywords : object
        As `Node` takes them.

    Attributes
    ----------
    closing_s, winding_s : float
        `close` and `wind_down` take so long at most, s.
    failed : str
        What has ended it, in one line, before exit code 2; '' while nothing has.
    done : bool
        Its work is done.

    Raises
    ------
    ConfigError
        If it is not `alone`.
    """

    closing_s, winding_s = CLOSING_S, 0.0
    failed, done = '', False
    _polled: frozenset[Subscription] = frozenset()

    def __init__(self, name: str, alone: bool = True, **keywords: Any) -> None:
        super().__init__(name, **keywords)
        self._diagnostics = Diagnostics(self, self._health, alone)
        self._workers: list[Worker] = []
        self.add_on_set_parameters_callback(_keeps_its_clock)
        if not alone:
            return
        if sys.platform == 'linux':
            self._hold_name()
        self._told: Mapping[str, Parameter] = {}
        self._teller = announce(self, 'parameters')
        self.create_timer(_LOOK_S, self._tell_parameters, clock=steady_clock())

    def _hold_name(self) -> None:
        """
        Hold the full name until the ROS context is shut down.

        Two speed nodes would drive one roller. Namesakes on other machines are seen by
        `diagnostics`.
        """
        name, domain = self.get_fully_qualified_name(), self.context.get_domain_id()
        try:
            self._held = hold(name, domain)
        except OSError as error:
            raise ConfigError(f'{error}: choose another namespace or ROS_DOMAIN_ID') from error
        self.context.on_shutdown(self._held.close)

    def _tell_parameters(self) -> None:
        """Publish all parameters, as a parameter file, where one is new or another."""
        told, given = self._told, self.get_parameters_by_prefix('')
        self._told = cast('dict[str, Parameter]', given)  # which they are, whatever rclpy says
        if self._told != told:
            text = parameter_file(self.get_fully_qualified_name(), self._told)
            self._teller.publish(String(data=text))

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that an executor waits for."""
        return (each for each in super().subscriptions if each not in self._polled)

    def create_polled_subscription(
        self, kind: Any, topic: str, *args: Any, **keywords: Any
    ) -> Subscription:
        """Subscribe like `create_subscription`, without a callback: see `hearing.waiting`."""
        subscription = self.create_subscription(kind, topic, _never, *args, **keywords)
        self._polled |= {subscription}
        return subscription

    def _health(self) -> Health:
        """Return what it says of itself on `/diagnostics`; by every node that is `alone`."""
        raise NotImplementedError

    def work(self, task: str, function: Callable[[Event], None], patience_s: float = 2.0) -> None:
        """Run a function in a thread until the node closes; see `Worker`."""
        self._workers.append(Worker(self._diagnostics.failed, task, function, patience_s))

    def beside(self, what: str, make: Callable[[Node], None]) -> None:
        """
        Have a node beside this one, in a thread of its own with the plain executor.

        Service clients crash the EventsExecutor of these wheels now and then, and a service that
        takes long holds up every message: both belong to another node.

        Parameters
        ----------
        what : str
            What it is for; behind the name of this one, in whose namespace it is.
        make : callable
            Gives it what it needs. The thread starts after that: a start in which two threads
            ask the middleware has hung.
        """
        node = hidden_node(f'_{self.get_name()}_{what}', self.get_namespace())
        make(node)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        self.work(what, partial(_serve, executor), 0.0)

    def begin(self) -> None:
        """Begin what waits for hardware: the node is made, and its parameters are known."""

    def wake(self) -> None:
        """Have threads that wait for something look whether they are to end."""

    def wind_down(self) -> bool:
        """Go where it is safe, while the node runs on; return True once nothing is left to do."""
        return True

    def close(self) -> None:
        """End its threads, and let go of what it holds, before its publishers are gone."""
        for worker in self._workers:
            worker.stopping.set()
        self.wake()
        for worker in self._workers:
            worker.stop()


def _serve(executor: SingleThreadedExecutor, stopping: Event) -> None:
    """Answer what a node is asked for."""
    try:
        while not stopping.is_set():
            executor.spin_once(timeout_sec=_ASKED_S)
    except ExternalShutdownException:
        pass
    finally:
        executor.shutdown()


def _keeps_its_clock(parameters: list[Parameter]) -> SetParametersResult:
    """Refuse another clock: who had it before would stamp by one, and count by the other."""
    kept = all(each.name != 'use_sim_time' for each in parameters)
    return SetParametersResult(successful=kept, reason='' if kept else _FIXED)


def _never(message: object) -> None:
    raise AssertionError('a polled subscription was given to an executor')
