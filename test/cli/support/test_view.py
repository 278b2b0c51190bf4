"""What is printed of a running rig where there is no terminal."""

from __future__ import annotations

import time

from hunt_ros.cli.support.view import View


def health(name: str) -> dict[str, str]:
    words = {'level': 'OK', 'message': 'sound', 'name': f'rig/{name}'}
    return {'topic': '/diagnostics', 'stamp_ns': '0', **words}


def test_a_node_that_freezes_is_told_once_and_again_when_it_is_back(capsys, monkeypatch) -> None:
    now = [100.0]
    monkeypatch.setattr(time, 'monotonic', lambda: now[0])
    with View() as view:
        for second in range(10):
            now[0] = 100.0 + second
            view.show(health('hunting_detector'))
            if second < 2 or second > 7:
                view.show(health('bag_recorder'))
    lines = capsys.readouterr().out.splitlines()
    assert lines == ['bag_recorder: silent for 4 s', 'bag_recorder: sound']


def test_silence_of_the_console_while_it_is_started_again_is_not_that_of_the_nodes(
    capsys, monkeypatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, 'monotonic', lambda: now[0])
    nodes = ['bag_recorder', 'hunting_detector', 'yaw_sensor']
    with View() as view:
        for second in [*range(5), *range(9, 15)]:
            now[0] = 100.0 + second
            for name in nodes[: 2 if second > 4 else 3]:  # one ends meanwhile
                now[0] += 0.1
                view.show(health(name))
    assert capsys.readouterr().out.splitlines() == ['yaw_sensor: silent for 9 s']


def test_speeds_are_in_the_unit_of_the_rig(capsys) -> None:
    with View(speed_unit='km/h') as view:
        event = {'event': 'quiet', 'speed_mps': '5.0', 'amplitude_m': '1e-5', 'message': 'v 5 m/s'}
        view.show({'topic': 'hunting/events', 'stamp_ns': '1', **event})
        view.say('the roller is at 7.20 m/s')
    text = capsys.readouterr().out
    assert '18.0 km/h' in text
    assert '(v 18.0 km/h)' in text
    assert text.endswith('the roller is at 25.9 km/h\n')


def test_a_form_that_may_have_to_wait_is_not_said_to_be_in_force(capsys) -> None:
    with View() as view:
        view.show({'topic': 'hunting/normal_form', 'data': ''})
    assert capsys.readouterr().out.splitlines() == ['a refitted normal form has come']
