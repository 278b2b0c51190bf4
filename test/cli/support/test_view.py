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
