"""config/sros2/policy.xml: what SROS2 expects, and what the nodes of the suite really use."""

from __future__ import annotations

import fnmatch
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hunt_ros.cli.support import suite
from hunt_ros.cli.support.console import Console
from hunt_ros.cli.support.processes import NodeSpec
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.cli.support.view import View
from hunt_ros.services import SERVICES
from hunt_ros.suite import (
    ALARM_OUTPUTS,
    LISTENERS,
    NODES,
    PAGE,
    SENSORS,
    SIMULATOR,
    SOURCES,
)

ROOT = Path(__file__).resolve().parents[2]
POLICY = ROOT / 'config' / 'sros2' / 'policy.xml'
#: Element -> its children, and the rules that it may have (sros2, policy.xsd of version 0.2.0).
_LISTS = {
    'topics': ('topic', {'publish', 'subscribe'}),
    'services': ('service', {'reply', 'request'}),
}
#: Subscribed by every node where time is simulated.
_CLOCK = '/clock'

#: Rule -> what is allowed, with full names, by enclave.
Allowed = dict[str, dict[str, set[str]]]


def _allowed() -> Allowed:
    """Return what the policy allows; names as sros2 resolves them."""
    found: Allowed = {}
    for enclave in ElementTree.parse(POLICY).getroot().iter('enclave'):
        rules = found.setdefault(enclave.get('path'), {})
        for profile in enclave.iter('profile'):
            namespace, node = profile.get('ns'), profile.get('node')
            for several in profile:
                for rule in several.attrib:
                    names = rules.setdefault(rule, set())
                    for one in several:
                        text = one.text.replace('~', f'{namespace}/{node}', 1)
                        names.add(text if text.startswith('/') else f'{namespace}/{text}')
    return found


def _node_enclaves() -> dict[str, str]:
    root = ElementTree.parse(POLICY).getroot()
    return {
        profile.get('node'): enclave.get('path')
        for enclave in root.iter('enclave')
        for profile in enclave.iter('profile')
    }


def test_the_policy_is_as_sros2_expects_it() -> None:
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.attrib) == ('policy', {'version': '0.2.0'})
    paths = [enclave.get('path') for enclave in root.iter('enclave')]
    assert len(set(paths)) == len(paths)
    profiles = list(root.iter('profile'))
    assert len({profile.get('node') for profile in profiles}) == len(profiles)
    for several in (each for profile in profiles for each in profile):
        child, rules = _LISTS[several.tag]
        assert set() < set(several.attrib) <= rules
        assert set(several.attrib.values()) <= {'ALLOW', 'DENY'}
        assert {one.tag for one in several} == {child}
        assert all(one.text and one.text.strip() == one.text for one in several)


def test_only_the_speed_node_drives_and_only_operators_act() -> None:
    allowed = _allowed()

    def who_may(rule: str, name: str) -> set[str]:
        return {
            enclave.rsplit('/', 1)[-1]
            for enclave, rules in allowed.items()
            if any(fnmatch.fnmatchcase(name, one) for one in rules.get(rule, ()))
        }

    assert who_may('publish', '/rig/speed/target') == {'roller_speed'}
    operators = {'console', 'dashboard', 'service_call'}
    assert who_may('request', '/rig/speed/emergency_stop') == operators
    assert who_may('request', '/rig/speed/start_profile') == operators
    assert who_may('request', '/rig/speed/rearm') == operators - {'console'}
    assert not who_may('request', '/rig/roller_speed/set_parameters')
    assert set(allowed['/rig/viewer']) == {'publish', 'subscribe', 'reply'}


def test_a_process_has_the_enclave_of_its_name() -> None:
    words = NodeSpec('roller_speed').command('rig')
    assert words[words.index('--enclave') + 1] == '/rig/roller_speed'
    assert '/rig/roller_speed' in _allowed()


@pytest.mark.slow
def test_every_name_that_the_suite_uses_is_allowed_and_no_other(graph) -> None:
    axle_box = SENSORS['axle_box']
    names = (*LISTENERS, SIMULATOR, *SOURCES, axle_box, ALARM_OUTPUTS, PAGE)
    here = {'directory': str(graph.folder)}
    parameters: dict[str, dict[str, object]] = {
        **{name: {'port': graph.port} for name in SOURCES},
        # The simulated rig has none; a device that does not answer is asked again and again.
        axle_box: {'driver': 'modbus', 'port': suite.free_port()},
        # With a clock of its own it uses all that it ever does.
        SIMULATOR: {'port': graph.port, 'time_scale': 2.0},
        'bag_recorder': here,
        'normal_form_identifier': here,
        PAGE: {**here, 'port': suite.free_port()},
        ALARM_OUTPUTS: {'command': '/bin/true'},
    }
    enclaves, node = _node_enclaves(), graph.node
    in_graph = {
        name for name, path in enclaves.items() if path.rsplit('/', 1)[-1] in (*names, 'console')
    }
    with Supervisor('rig', graph.folder / 'logs', private=False, keep=False) as processes:
        Console(processes, View())
        suite.start_nodes(processes, names, {}, parameters, one_process=True)

        def all_are_there() -> bool:
            assert processes.look() == []
            there = {name for name, _ in node.get_node_names_and_namespaces()}
            return in_graph <= there and '/rig/hunting/accept_normal_form' in dict(
                node.get_service_names_and_types()
            )

        graph.spin_until(all_are_there, 120.0)
        used: Allowed = {}
        looks = {
            'publish': node.get_publisher_names_and_types_by_node,
            'subscribe': node.get_subscriber_names_and_types_by_node,
            'reply': node.get_service_names_and_types_by_node,
            'request': node.get_client_names_and_types_by_node,
        }

        def look() -> bool:
            """Look until nothing has changed for a second."""
            nonlocal used, changed
            before, used = used, {}
            for name, namespace in node.get_node_names_and_namespaces():
                if name == node.get_name():
                    continue
                assert name in enclaves, f'{name} has no enclave'
                for rule, ask in looks.items():
                    told = {topic for topic, _ in ask(name, namespace)}
                    used.setdefault(enclaves[name], {}).setdefault(rule, set()).update(told)
            changed = time.monotonic() if used != before else changed
            return time.monotonic() - changed > 1.0

        changed = time.monotonic()
        graph.spin_until(look)

    allowed = _allowed()
    everything = {rule: set().union(*(of[rule] for of in used.values())) for rule in looks}
    for enclave, rules in used.items():
        for rule, told in rules.items():
            may = allowed[enclave].get(rule, set())
            denied = {n for n in told if not any(fnmatch.fnmatchcase(n, one) for one in may)}
            assert not denied, f'{enclave} may not {rule} {denied}'
    # The operator's programs ask for these services too; a rig has none.
    of_a_replay = {f'/rig/{one.name}' for one in SERVICES.values() if one.node not in NODES}
    for enclave, rules in allowed.items():
        for rule, may in rules.items():
            # Of a process that was not started: what it asks for is there.
            other = {'request': 'reply', 'subscribe': 'publish'}.get(rule, rule)
            told = used[enclave].get(rule, set()) if enclave in used else everything[other]
            idle = {n for n in may if '*' not in n} - told - {_CLOCK} - of_a_replay
            idle -= {'/rig/axle_box'}  # of a rig that has one
            assert not idle, f'{enclave} may {rule} {idle}, and does not'
