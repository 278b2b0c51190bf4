"""
The node behind `hunt call`: calls one service, prints the answer as JSON, and ends.

`success` is null where nobody offers the service, or nobody answers.
"""

from __future__ import annotations

import json
from concurrent.futures import Future
from dataclasses import dataclass

from hunt_ros.nodes.support.caller import Answer, Caller
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.services import SERVICES
from hunt_ros.settings import Settings, setting

#: Closing a recording may take as long as this, s.
_ANSWER_S = 90.0


@dataclass(frozen=True)
class CallConfig(Settings):
    """Parameters of a call."""

    word: str = setting('', 'Word of `hunt call`.', choices=('', *SERVICES))
    wait_s: float = setting(5.0, 'How long to look for it.', unit='s', low=0.0)
    words: str = setting('', 'Published before the call.')


class ServiceCallNode(SuiteNode):
    """Calls, prints, and is done."""

    def __init__(self) -> None:
        super().__init__('service_call', alone=False)
        config = declare(self, CallConfig)
        self._caller = Caller(self, [config.word], config.wait_s, _ANSWER_S)
        self._name = self.resolve_service_name(SERVICES[config.word].name)
        self._caller.call(config.word, config.words).add_done_callback(self._print)

    def _print(self, answer: Future[Answer]) -> None:
        success, message, heard = answer.result()
        said = {'service': self._name, 'success': success if heard else None, 'message': message}
        print(json.dumps(said), flush=True)
        self.done = True


make_node = ServiceCallNode
