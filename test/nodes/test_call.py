"""`hunt call`: an operator's words reach the rig, and its refusals reach the operator."""

from __future__ import annotations

import subprocess

import pytest
from processes import HUNT
from std_srvs.srv import SetBool, Trigger

from hunt_ros.bag import Bag
from hunt_ros.bag.messages import read_texts
from hunt_ros.cli.main import main
from hunt_ros.services import SERVICES


@pytest.mark.slow
def test_a_call_is_done_refused_or_finds_nobody(graph, capsys) -> None:
    assert main(['call', 'acknowledge', '--wait', '0.5']) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert '/rig/hunting/acknowledge_alarm' in error
    assert 'hunting_detector' in error
    assert main(['call', 'test-alarm', '--wait', '0.5']) == 2
    assert 'the section alarm_outputs of the rig file' in capsys.readouterr().err

    graph.start('rig_simulator', port=graph.port)
    wait = ['--wait', '120']
    assert main(['call', 'kick', *wait]) == 0  # the simulator is up: the drive finds it
    graph.start('roller_speed', port=graph.port)
    graph.start('bag_recorder', directory=str(graph.folder))
    assert main(['call', 'mark', 'bump 🔔 at joint 3', *wait]) == 0
    assert main(['call', 'resume-profile', *wait]) == 1
    assert 'no profile was started' in capsys.readouterr().out
    assert main(['call', 'disarm-interlock', *wait]) == 0
    assert 'disarmed' in capsys.readouterr().out
    for word in ('arm-interlock', 'emergency-stop', 'stop-recording'):
        assert main(['call', word, *wait]) == 0
    assert main(['call', 'stop-recording', *wait]) == 1
    assert 'no recording is running' in capsys.readouterr().out
    (bag,) = graph.folder.glob('hunt_*')
    with Bag(bag) as opened:
        texts = read_texts(opened, 'recording/mark')
    assert texts == ['bump 🔔 at joint 3']

    looking_s = 5.0 * graph.machine.measure()
    assert main(['call', 'mark', '--namespace', 'lab', '--wait', f'{looking_s:.0f}']) == 2
    assert '--namespace rig' in capsys.readouterr().err
    # What these nodes offer to an operator is in the table.
    nodes = ('rig_simulator', 'roller_speed', 'bag_recorder')
    expected = {item.name for item in SERVICES.values() if item.node in nodes}

    def offered() -> set[str]:
        return {
            name.removeprefix('/rig/')
            for node, namespace in graph.node.get_node_names_and_namespaces()
            if any(name in node for name in nodes)
            for name, kinds in graph.node.get_service_names_and_types_by_node(node, namespace)
            if kinds[0] in ('std_srvs/srv/Trigger', 'std_srvs/srv/SetBool')
        }

    graph.spin_until(lambda: offered() >= expected)  # nodes find each other one by one
    assert offered() == expected


@pytest.mark.parametrize(
    ('word', 'lost', 'kind'),
    [('emergency-stop', 2, Trigger), ('arm-interlock', 1, SetBool), ('rearm', 0, Trigger)],
)
def test_a_call_whose_answer_is_lost_is_repeated_where_that_does_no_harm(
    graph, word, lost, kind
) -> None:
    speed = graph.beside('roller_speed')
    service = speed.create_service(kind, SERVICES[word].name, lambda request, response: response)
    words = [*HUNT, 'call', word, '--wait', '120']
    asked = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    headers: list = []

    def come() -> int:
        """Take requests as a server does whose answer does not arrive."""
        request, header = service.handle.service_take_request(kind.Request)
        headers.extend([header] if request is not None else [])
        return len(headers)

    graph.spin_until(lambda: come() > lost, 60.0)
    if not lost:  # nothing else comes
        graph.spin(2.5)
        assert come() == 1
    service.send_response(kind.Response(success=True, message='heard'), headers[-1])
    assert graph.machine.wait_for(asked) == 0
    assert asked.stdout.read() == 'heard\n'
    speed.destroy_node()
