"""The launch file, on stand-ins of `launch` and `launch_ros`, which no wheel brings."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from hunt_ros.errors import ConfigError
from hunt_ros.sensors import MOTION
from hunt_ros.suite import SENSORS

ROOT = Path(__file__).parents[1]


class _Kept:
    """Keeps what it was made of."""

    def __init__(self, *positional: Any, **named: Any) -> None:
        self.positional, self.named = positional, named


class _Argument:
    """A launch argument that is read: its value is in the context."""

    def __init__(self, name: str) -> None:
        self.name = name

    def perform(self, context: dict[str, str]) -> str:
        return context[self.name]


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch):
    """Return a function that gives the nodes of the suite for values of the arguments."""
    names: dict[str, dict[str, object]] = {
        'launch': {'LaunchContext': dict, 'LaunchDescription': _Kept},
        'launch.actions': {'DeclareLaunchArgument': _Kept, 'OpaqueFunction': _Kept},
        'launch.substitutions': {'LaunchConfiguration': _Argument},
        'launch_ros': {},
        'launch_ros.actions': {'Node': _Kept},
        'ament_index_python': {},
        'ament_index_python.packages': {'get_package_share_directory': lambda name: str(ROOT)},
    }
    for name, members in names.items():
        module = ModuleType(name)
        for member, value in members.items():
            setattr(module, member, value)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location('launch_file', ROOT / 'launch' / 'rig.launch.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (actions,) = module.generate_launch_description().positional
    *declared, opaque = actions
    defaults = {each.positional[0]: each.named['default_value'] for each in declared}

    choices = {each.positional[0]: each.named['choices'] for each in declared}

    def nodes(**arguments: str) -> list[_Kept]:
        assert set(arguments) <= set(defaults)
        for name, value in {**defaults, **arguments}.items():
            assert choices[name] is None or value in choices[name]
        return opaque.named['function']({**defaults, **arguments})

    return nodes


def test_every_node_of_the_suite_is_launched_once_with_the_default_file(launched) -> None:
    nodes = launched()
    names = [node.named['executable'] for node in nodes]
    assert sorted(names) == [
        'bag_recorder', 'hunting_detector', 'lateral_sensor', 'normal_form_identifier',
        'rig_simulator', 'roller_speed', 'yaw_sensor',
    ]  # fmt: skip
    for node in nodes:
        assert node.named['parameters'][0] == str(ROOT / 'config' / 'rig.yaml')
        enclave = f'/rig/{node.named["executable"]}'
        words = ['--ros-args', '--log-level', 'info', '--enclave', enclave]
        assert node.named['arguments'] == words


def test_the_sensor_nodes_are_those_of_the_channels_of_the_rig(launched, tmp_path: Path) -> None:
    assert tuple(SENSORS) == MOTION
    rig = tmp_path / 'rig.yaml'
    rig.write_text('/**: {ros__parameters: {channels: [lateral, axle_box, speed]}}')
    names = [node.named['executable'] for node in launched(rig=str(rig), simulated='false')]
    assert {name for name in names if name.endswith('_sensor')} == {
        'lateral_sensor', 'axle_box_sensor',
    }  # fmt: skip


def test_a_mistyped_file_ends_the_launch_and_says_which(launched, tmp_path: Path) -> None:
    for argument in ('rig', 'normal_form'):
        with pytest.raises(FileNotFoundError, match=rf'{argument}:=.*my_rgi\.yaml'):
            launched(**{argument: str(tmp_path / 'my_rgi.yaml')})


def test_without_sensors_only_the_listeners_start(launched) -> None:
    names = [node.named['executable'] for node in launched(sensors='false')]
    assert names == ['bag_recorder', 'hunting_detector', 'normal_form_identifier']
    names = [node.named['executable'] for node in launched(simulated='false')]
    assert 'rig_simulator' not in names
    assert 'roller_speed' in names


def test_one_process_has_the_same_nodes_and_parameters(launched) -> None:
    several = launched(respawn='true')
    guard, node = launched(one_process='true', respawn='true')
    assert guard.named['executable'] == several[0].named['executable'] == 'roller_speed'
    assert guard.named['parameters'] == several[0].named['parameters']
    assert node.named['executable'] == 'suite'
    *names, _, _, _ = node.named['arguments']
    assert names == [each.named['executable'] for each in several[1:]]
    assert node.named['parameters'] == several[1].named['parameters']
    assert node.named['respawn'] is several[1].named['respawn'] is True


def test_only_a_rig_that_is_not_simulated_is_guarded_for_good(launched, tmp_path) -> None:
    simulated, *_ = launched()
    assert {'slow_down_at_end': False} in simulated.named['parameters']
    real, *_ = launched(simulated='false')
    assert {'slow_down_at_end': False} not in real.named['parameters']
    assert float(real.named['sigterm_timeout']) > 100.0, 'launch would end it after 5 s'
    assert real.named['respawn'] is True, 'a guard that is gone leaves the roller as it was'
    assert simulated.named['respawn'] is False
    rig = tmp_path / 'rig.yaml'
    rig.write_text('/**/bag_recorder: {ros__parameters: {directory: /data/lab}}')
    real, *_ = launched(simulated='false', rig=str(rig))
    kept = {'state_file': '/data/lab/.rig_speed_state.json'}
    assert kept in real.named['parameters'], 'where hunt run keeps it'


def test_what_is_not_given_does_not_override_the_users_file(launched, tmp_path: Path) -> None:
    rig, form = tmp_path / 'rig.yaml', tmp_path / 'normal_form.yaml'
    for path in (rig, form):
        path.write_text('/**: {ros__parameters: {lines: [1.0]}}')
    files = [str(rig), str(form)]
    (_, node, *_) = launched(rig=str(rig), normal_form=str(form))
    assert node.named['parameters'] == files
    (_, node, *_) = launched(rig=str(rig), normal_form=str(form), use_sim_time='false')
    *first, last = node.named['parameters']
    assert first == files
    assert list(last) == ['use_sim_time']


def test_the_page_is_a_process_of_its_own_where_it_is_asked_for(launched) -> None:
    (_, suite, page) = launched(page='true', one_process='true')
    assert page.named['executable'] == 'dashboard'
    assert 'dashboard' not in suite.named['arguments']
    names = [node.named['executable'] for node in launched(page='true')]
    assert names.count('dashboard') == 1


def test_alarm_outputs_start_where_the_rig_file_names_one(launched, tmp_path: Path) -> None:
    rig = tmp_path / 'rig.yaml'
    rig.write_text('/rig/alarm_outputs: {ros__parameters: {command: /bin/true}}')
    _, alarm, suite = launched(rig=str(rig), one_process='true')
    assert alarm.named['executable'] == 'alarm_outputs'
    assert alarm.named['parameters'] == [str(rig)]
    assert 'alarm_outputs' not in suite.named['arguments']
    rig.write_text('/rig/alarm_outputs: {ros__parameters: {silence_s: 3.0}}')
    assert len(launched(rig=str(rig), one_process='true')) == 2
    rig.write_text('/rig/alarm_outputs: {ros__parameters: {command: /nowhere/notify}}')
    with pytest.raises(ConfigError, match=r'rig\.yaml: alarm_outputs: .*/nowhere/notify'):
        launched(rig=str(rig))
