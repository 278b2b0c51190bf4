"""
The threads of a node: none ends in silence, and what waits for a service is beside the node.

An error that nobody expected is logged with its traceback and stands on `/diagnostics` from then
on: a node whose thread is gone must not look well.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from functools import partial

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from hunt_ros.errors import HuntError

#: An end is noticed so soon, s.
_LOOK_S = 0.1
#: Gets the name of a task and the error that ended it: `Diagnostics.failed`.
Failed = Callable[[str, Exception], None]


class Worker:
    """
    Runs a function in a thread, from now until it returns or is asked to stop.

    Parameters
    ----------
    failed : callable
        Told when the function raises.
    name : str
        Of the thread.
    work : callable
        Gets the event that asks it to return. Each worker has its own: a thread that
        was too slow to end in time can never be taken for its successor.
    """

    def __init__(self, failed: Failed, name: str, work: Callable[[threading.Event], None]) -> None:
        self._failed, self._name, self._work = failed, name, work
        self.stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float = 2.0) -> None:
        """Ask it to return, and wait so long for it."""
        self.stopping.set()
        self._thread.join(timeout=timeout_s)

    def _run(self) -> None:
        try:
            self._work(self.stopping)
        except Exception as error:
            if not self.stopping.is_set():  # else: what it used is gone already
                self._failed(self._name, error)


class Aside:
    """
    A node beside the node, in a thread of its own with the plain executor, which `start` starts.

    Service clients crash the EventsExecutor of these wheels now and then, and a service that takes
    long holds up every message: both belong to another node. The thread is started when a node
    has made what it needs: a start in which two threads ask the middleware has hung.

    Parameters
    ----------
    node : Node
        Whose namespace it has, and its name with `name` behind.
    failed : callable
        Told when the thread ends with an error.
    name : str
        What it is for.
    """

    def __init__(self, node: Node, failed: Failed, name: str) -> None:
        self.node = hidden_node(f'_{node.get_name()}_{name}', node.get_namespace())
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._begin = partial(Worker, failed, name, self._work)
        self._worker: Worker | None = None

    def start(self) -> None:
        """Answer from now on."""
        self._worker = self._begin()

    def close(self, timeout_s: float = 2.0) -> None:
        """End the thread; one that is busy is left to itself after so long."""
        if self._worker is not None:
            self._worker.stop(timeout_s)

    def _work(self, stopping: threading.Event) -> None:
        try:
            while not stopping.is_set():
                self.executor.spin_once(timeout_sec=_LOOK_S)
        except ExternalShutdownException:
            pass
        finally:
            self.executor.shutdown()


def offer(node: Node, name: str, answer: Callable[[], str], of: Node | None = None) -> None:
    """
    Offer a Trigger service.

    Parameters
    ----------
    node : Node
        Which offers it.
    name : str
        Relative.
    answer : callable
        Does the work and returns the message of the answer; an error is the answer of a service
        that failed.
    of : Node, optional
        Whose log is told of an error that nobody expected.
    """
    log = (of or node).get_logger()

    def answered(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Fill in the answer; what fails is the answer too."""
        try:
            response.success, response.message = True, answer()
        except HuntError as error:
            response.success, response.message = False, str(error)
        except Exception as error:  # any other would end the thread, and every service
            response.success, response.message = False, f'{type(error).__name__}: {error}'
            log.error(f'{name}: {response.message}')
        return response

    node.create_service(Trigger, name, answered)


def answer_aside(node: Node, failed: Failed, answers: Mapping[str, Callable[[], str]]) -> Aside:
    """Offer Trigger services beside the node, see `offer`; they are answered one by one."""
    beside = Aside(node, failed, 'services')
    for name, answer in answers.items():
        offer(beside.node, name, answer, node)
    beside.start()
    return beside


def hidden_node(name: str, namespace: str = '', context: Context | None = None) -> Node:
    """Return a node without parameters of its own and without a log topic; `_` hides its name."""
    return rclpy.create_node(
        name,
        context=context,
        namespace=namespace,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
    )
