"""The node of the page, with real nodes: what it shows over a websocket, what it calls."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time

import pytest

pytest.importorskip('tornado', reason='the extra dashboard is not installed')

from diagnostic_msgs.msg import DiagnosticArray
from processes import joint
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from told_made import ask
from tornado.websocket import websocket_connect

from hunt_ros.cli.support.suite import free_port
from hunt_ros.nodes.dashboard import DashboardNode
from hunt_ros.nodes.support.conversions import diagnostic
from hunt_ros.nodes.support.qos import latched, stream


class Viewer:
    """A page: keeps what the server sends."""

    def __init__(self, port: int) -> None:
        self.sections: dict = {}
        self.rows: dict[str, list] = {}
        url = f'ws://127.0.0.1:{port}/live'
        threading.Thread(target=lambda: asyncio.run(self._listen(url)), daemon=True).start()

    async def _listen(self, url: str) -> None:
        link = await websocket_connect(url)
        while (text := await link.read_message()) is not None:
            message = json.loads(text)
            self.sections |= message.get('sections', {})
            for name, change in message.get('streams', {}).items():
                self.rows.setdefault(name, []).extend(change['rows'])

    def level(self) -> str:
        return self.sections.get('status', {}).get('level', '')


def command(port: int, word: str, words: str = '') -> dict:
    return json.loads(ask(f'http://127.0.0.1:{port}/command', {'word': word, 'words': words})[1])


def test_the_page_shows_what_the_topics_say_and_calls_what_is_asked_for(
    graph, resident, detector
) -> None:
    port = free_port()
    resident(DashboardNode, port=port)
    viewer = Viewer(port)
    heard: list[str] = []
    names = graph.collect(String, 'hunting_detector/calls', stream(10))

    def acknowledge(request, response):
        heard.append('acknowledged')
        response.success = True
        return response

    graph.node.create_service(Trigger, 'hunting/acknowledge_alarm', acknowledge)
    lateral = graph.node.create_publisher(JointState, 'lateral', stream(100))
    graph.node.create_timer(0.05, lambda: lateral.publish(joint('lateral', time.time_ns(), 1e-3)))
    drive = graph.node.create_publisher(DiagnosticArray, 'speed/status', latched())
    running = {'profile_state': 'running', 'emergency_stop': False}
    drive.publish(diagnostic(0, 'roller_speed', 'OK', '', running, 'rig'))

    graph.spin_until(lambda: viewer.level() == 'OK' and len(viewer.rows.get('lateral', ())) > 3)
    detector.level = 'ERROR'
    graph.spin_until(lambda: viewer.level() == 'ERROR')
    assert viewer.sections['drive']['profile_state'] == 'running'
    assert viewer.rows['lateral'][0][2] == 1.0
    detector.silent = True
    graph.spin_until(lambda: viewer.level() == 'STALE')
    assert 'silent' in viewer.sections['status']['why']
    detector.silent = False
    graph.spin_until(lambda: viewer.level() == 'ERROR')

    answers: list[dict] = []
    asked = threading.Thread(
        target=lambda: answers.append(command(port, 'acknowledge', 'Mia')), daemon=True
    )
    graph.spin_until(lambda: viewer.sections['nodes'], 30.0)
    asked.start()
    graph.spin_until(lambda: answers, 60.0)
    assert answers == [{'done': True, 'message': ''}]
    assert heard == ['acknowledged']
    graph.spin_until(lambda: names)
    said = json.loads(names[0].data)
    assert (said['service'], said['words']) == ('acknowledge', 'Mia')
    assert said['who'].endswith(' (dashboard)')
    absent = command(port, 'emergency-stop')
    assert not absent['done']
    # One that a test before this has killed is still announced for some seconds.
    assert 'roller_speed' in absent['message']
    assert not command(port, 'no-such-word')['done']


def test_a_port_in_use_ends_the_node_with_one_line(graph) -> None:
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        graph.start('dashboard', port=port)
        assert graph.wait('dashboard', 60.0) == 2
    said = graph.log('dashboard').read_text()
    assert f'port {port}' in said
    assert 'Traceback' not in said
