"""
How a process of one node, or of several, starts, spins and ends.

A signal asks the loop to end, so a node closes its files and publishes its last
words while the ROS context is still alive; `ending` sees to it that the process
ends in any case. The EventsExecutor can crash on
entities that are destroyed while it spins (ros2/rclpy #1644): a node keeps what
it has created until it ends.
"""

from __future__ import annotations

import faulthandler
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import InvalidParameterValueException, ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier as rmw_identifier

from hunt_ros.errors import HuntError
from hunt_ros.nodes.support.ending import CLOSING_S, Ending
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import refuse_unknown
from hunt_ros.suite import AGAIN

#: Kilted begins with Fast DDS 3: another variable for the file of its profiles, other words in it.
_KILTED = int(version('rclpy').partition('.')[0]) >= 9
_PROFILE = 'fast_dds_3' if _KILTED else 'fast_dds'
#: Who sets one of these has chosen how Fast DDS talks.
_CHOICES = (
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTDDS_BUILTIN_TRANSPORTS',
)
_SPIN_S = 0.05
#: The system signals the death of who started this process before all its threads have gone, and
#: only then is it seen, s.
_ABANDONED_S = 0.5
#: For the last messages to arrive, s.
_DELIVERY_S = 0.4


def cheapest_executor(context: Context | None = None) -> Executor:
    """Return the executor that costs least in this ROS: Humble has no EventsExecutor."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def run(
    makers: Sequence[Callable[[], SuiteNode]],
    ending: Ending,
    arguments: Sequence[str] | None = None,
) -> int:
    """
    Run nodes until they are asked to end, or done; where it is safe comes first.

    Parameters
    ----------
    makers : sequence of callable
        Each makes a node; a HuntError or a refused parameter of one ends the process. The last
        one is closed first.
    ending : Ending
        Hears the signals.
    arguments : sequence of str, optional
        Command line, with `--ros-args`.

    Returns
    -------
    int
        0 after a clean end, 2 for bad parameters or hardware that is not there, 1 for what fails
        later: who started the node starts it again.
    """
    # ROS that finds no place for its log does not start; one that it had may be gone since.
    if AGAIN in os.environ or not {'HOME', 'ROS_LOG_DIR'} & {*os.environ}:
        os.environ['ROS_LOG_DIR'] = tempfile.gettempdir()
    _choose_transport()
    words = None if arguments is None else list(arguments)
    try:
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # a folder of its logs that is none, options that are none
        ending.say(f'ROS does not start: {" ".join(str(error).split())}')
        return 2
    nodes: list[SuiteNode] = []
    executor = cheapest_executor()
    try:
        for make_node in makers:
            nodes.append(make_node())
            refuse_unknown(nodes[-1])
            nodes[-1].begin()
        for node in nodes:
            executor.add_node(node)
        ending.doing = 'running'
        faulthandler.cancel_dump_traceback_later()
        # spin() of the EventsExecutor in these wheels burns a core and runs nothing.
        while rclpy.ok() and not ending.asked.is_set():
            executor.spin_once(timeout_sec=_SPIN_S)
            _raise_failures(nodes)
            if all(node.done for node in nodes):
                return 0
        if winding_s := max(node.winding_s for node in nodes):
            ending.grant('taking the rig to where it is safe', winding_s, patient=False)
        known_s = time.monotonic() + (_ABANDONED_S if winding_s else 0.0)
        while rclpy.ok():
            if all(node.wind_down() for node in nodes) and time.monotonic() >= known_s:
                break
            executor.spin_once(timeout_sec=_SPIN_S)
        _raise_failures(nodes)
    except (HuntError, InvalidParameterValueException, ParameterException) as error:
        ending.say(' '.join(str(error).split()))
        return 2 if ending.doing == 'starting' or any(node.failed for node in nodes) else 1
    except ExternalShutdownException:
        pass
    finally:
        ending.grant('closing', sum(node.closing_s for node in nodes) or CLOSING_S)
        executor.shutdown()  # before anything it holds is destroyed
        for node in reversed(nodes):
            node.close()
            _deliver(node)
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _choose_transport() -> None:
    """Give Fast DDS the profile of the nodes, unless the user has chosen how it talks."""
    told = os.environ
    if {*_CHOICES} & told.keys() or 'fastrtps' not in rmw_identifier():
        return
    this_host = ''
    asked = told.get('ROS_AUTOMATIC_DISCOVERY_RANGE'), 'ROS_STATIC_PEERS' in told
    if told.pop('ROS_LOCALHOST_ONLY', '0') == '1' or asked == ('LOCALHOST', False):
        told['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'
        this_host = '_this_host'
    told[_CHOICES[_KILTED]] = str(Path(__file__).with_name(f'{_PROFILE}{this_host}.xml'))


def _raise_failures(nodes: Sequence[SuiteNode]) -> None:
    for node in nodes:
        if node.failed:
            raise HuntError(node.failed)


def _deliver(node: SuiteNode) -> None:
    """Wait, not for long, until everybody who listens has what the node said last."""
    deadline = time.monotonic() + _DELIVERY_S
    for publisher in node.publishers:
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))
