"""
The node behind `hunt call`: calls one Trigger service, or a switch, prints the answer, and ends.

One line of JSON on standard output: `success` and `message` as the service said; without
`success` where nobody offers it (`elsewhere`: where it is offered) or nobody answers (`silent`).
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass

from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from hunt_ros.nodes.support.asking import INTRODUCED_S, ask
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.qos import stream
from hunt_ros.settings import Settings, setting

#: Closing a recording may take as long as this, s.
_ANSWER_S = 90.0


@dataclass(frozen=True)
class CallConfig(Settings):
    """Parameters of a call."""

    service: str = setting('', 'Relative name of the service.', fixed=True)
    wait_s: float = setting(5.0, 'How long to look for it.', unit='s', low=0.0, fixed=True)
    words: str = setting('', 'Published before the call.', fixed=True)
    words_topic: str = setting('', 'Where the words go.', fixed=True)
    repeatable: bool = setting(False, 'It may be called twice.', fixed=True)
    switch: str = setting(
        '', 'Of a SetBool service; empty: a Trigger.', choices=('', 'on', 'off'), fixed=True
    )


def call(node: Node, config: CallConfig) -> dict[str, object]:
    """
    Publish the words, and call the service.

    Returns
    -------
    dict
        What is printed.
    """
    full = node.resolve_service_name(config.service)
    answer: dict[str, object] = {'service': full, 'relative': config.service}
    kind = SetBool if config.switch else Trigger
    client = node.create_client(kind, config.service)
    if not client.wait_for_service(timeout_sec=config.wait_s):
        names = {name for name, _ in node.get_service_names_and_types()} - {full}
        ending = f'/{config.service}'
        return {**answer, 'elsewhere': sorted(name for name in names if name.endswith(ending))}
    if not config.repeatable:
        time.sleep(INTRODUCED_S)
    if config.words and not _publish(node, config):
        return {**answer, 'success': False, 'message': f'nobody listens to {config.words_topic}'}
    request = SetBool.Request(data=config.switch == 'on') if config.switch else Trigger.Request()
    said = ask(node, client, request, _ANSWER_S, repeatable=config.repeatable)
    if said is None:
        return {**answer, 'silent': True}
    return {**answer, 'success': said.success, 'message': said.message}


def _publish(node: Node, config: CallConfig) -> bool:
    """Publish the words; False where nobody has taken them."""
    publisher = node.create_publisher(String, config.words_topic, stream(10))
    deadline = time.monotonic() + max(config.wait_s, 1.0)
    while not publisher.get_subscription_count():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    publisher.publish(String(data=config.words))
    return publisher.wait_for_all_acked(Duration(seconds=5.0))


class ServiceCallNode(Node):
    """Calls, prints, and is done."""

    done = True

    def __init__(self) -> None:
        super().__init__('service_call')
        print(json.dumps(call(self, declare(self, CallConfig))), flush=True)


make_node = ServiceCallNode
