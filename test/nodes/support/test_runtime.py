"""How a node runs: without an EventsExecutor, as in Humble, and until something fails."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
from made import python

from hunt_ros.nodes.support import runtime


def test_a_node_runs_without_an_events_executor(graph, monkeypatch) -> None:
    script = "import sys\nsys.modules['rclpy.experimental'] = None\n"
    (graph.folder / 'sitecustomize.py').write_text(script)
    monkeypatch.setenv('PYTHONPATH', f'{graph.folder}{os.pathsep}{os.environ["PYTHONPATH"]}')
    health = graph.told()
    graph.start('roller_speed', port=graph.port)  # where nobody answers
    graph.spin_until(lambda: health)


_FAILS = """
from hunt_ros.drivers import speed_guard
from hunt_ros.errors import HuntError
def values(guard):
    raise HuntError('it failed')
speed_guard.SpeedGuard.values = values
"""


def test_a_guard_that_fails_while_it_runs_has_not_refused_to_start(graph, monkeypatch) -> None:
    """Exit code 2 is that of a start: what started it would let it be."""
    (graph.folder / 'sitecustomize.py').write_text(_FAILS)
    monkeypatch.setenv('PYTHONPATH', f'{graph.folder}{os.pathsep}{os.environ["PYTHONPATH"]}')
    kept = graph.folder / 'state.json'
    graph.start('roller_speed', port=graph.port, state_file=kept)
    assert graph.wait('roller_speed', 60.0) == 1
    assert json.loads(kept.read_text())['running'], 'nobody has taken the roller down'
    assert graph.log('roller_speed').read_text().splitlines()[-1] == 'roller_speed: it failed'


_MANY = """
import os, sys, time
import rclpy
from hunt_ros.nodes.support import runtime
runtime._choose_transport()
nodes = []
for number in range(40):
    context = rclpy.Context()
    rclpy.init(context=context)
    nodes.append(rclpy.create_node(f'node{number}', context=context))
end_s = time.monotonic() + float(sys.argv[1])
while time.monotonic() < end_s:
    if all('node38' in node.get_node_names() for node in nodes[-3:]):
        os._exit(0)
    time.sleep(0.1)
os._exit(1)
"""


def test_forty_processes_of_one_host_find_each_other(machine, domain) -> None:
    python('-c', _MANY, 30.0 * machine.measure())


@pytest.mark.parametrize('where', ['', '_this_host'])
def test_both_versions_of_fast_dds_are_told_the_same(where) -> None:
    """Each refuses a profile with a word of the other, and talks as it likes then."""
    folder = Path(runtime.__file__).parent
    old, new = ((folder / f'{name}{where}.xml').read_text() for name in ('fast_dds', 'fast_dds_3'))
    here = r'<interface(?:s|WhiteList)>.*?127.0.0.1.*?</interface(?:s|WhiteList)>'
    for word, then in (('Fast DDS 2', 'Fast DDS 3'), ('heartbeatPeriod', 'heartbeat_period')):
        old = old.replace(word, then)
    (old, count), (new, same) = (re.subn(here, '', each, flags=re.S) for each in (old, new))
    assert count == same == bool(where)
    assert old == new
