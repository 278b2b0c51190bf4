"""What the console prints: a whole line each, whoever has something to say."""

from __future__ import annotations

import json

from made import python

#: Answers come in another thread than what is heard.
_TALK = """
import sys, threading
from hunt_ros.nodes.console import _write
sys.setswitchinterval(1e-6)
def say(who):
    for count in range(2000):
        _write({'topic': who, 'count': count})
threads = [threading.Thread(target=say, args=(who,)) for who in ('answer', 'heard', 'told')]
for thread in threads: thread.start()
for thread in threads: thread.join()
"""


def test_threads_that_speak_at_once_do_not_spoil_each_others_lines() -> None:
    said = [json.loads(line) for line in python('-c', _TALK).stdout.splitlines()]
    for who in ('answer', 'heard', 'told'):
        assert [one['count'] for one in said if one['topic'] == who] == list(range(2000))
