"""What a lab PC is set up with: the unit of systemd, and the tree of everybody's health."""

from __future__ import annotations

import configparser
import os
import shlex
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import yaml

from hunt_ros.cli.main import main
from hunt_ros.suite import NODES

CONFIG = Path(__file__).parents[1] / 'config'


def test_the_unit_starts_a_command_that_there_is_and_ends_it_with_an_interrupt(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    unit = configparser.ConfigParser(strict=False)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read(CONFIG / 'hunt_ros.service')
    program, *words = shlex.split(unit['Service']['ExecStart'])
    assert Path(program).name == 'hunt'
    # Its rig file is not on this machine: all else of the command is understood.
    words[words.index('--directory') + 1] = str(tmp_path)
    assert main(words) == 2
    assert '/etc/hunt/rig.yaml' in capsys.readouterr().err
    assert unit['Service']['KillSignal'] == signal.SIGINT.name
    assert {'dialout', 'audio'} <= set(unit['Service']['SupplementaryGroups'].split())
    assert unit['Service']['Environment'] == 'ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST', 'the last'
    assert unit['Service']['KillMode'] == 'control-group', 'who is left is not killed at once'
    # So hunt ends its nodes itself, in order: the rest waits until it has ended.
    stop = shlex.split(unit['Service']['ExecStop'].replace('$$', '$'))
    # What started the tests may have ignored an interrupt.
    heeds = 'import signal, time; signal.signal(signal.SIGINT, signal.SIG_DFL); print(flush=True)'
    words = [sys.executable, '-c', f'{heeds}; time.sleep(1000)']
    quiet = subprocess.DEVNULL
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=quiet) as program:
        program.stdout.readline()
        reaper = threading.Thread(target=program.wait)
        reaper.start()
        try:
            subprocess.run(stop, env={'MAINPID': str(program.pid)}, stderr=quiet, timeout=60.0)
            with pytest.raises(ProcessLookupError):
                os.kill(program.pid, 0)
            reaper.join(60.0)
            assert program.returncode == -signal.SIGINT
        finally:
            program.kill()
    assert subprocess.run(stop, env={}, stderr=quiet, timeout=60.0).returncode != 0


def test_every_node_has_its_place_in_the_tree_of_health() -> None:
    file = yaml.safe_load((CONFIG / 'diagnostics.yaml').read_text())
    groups = file['analyzers']['ros__parameters']
    parts = [word for one in groups.values() if isinstance(one, dict) for word in one['contains']]
    for node in (*NODES, 'hunting_alarm'):
        assert sum(word in node for word in parts) == 1, node
