"""`hunt replay --live`: the recording on the topics of the rig, events as they come."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

if TYPE_CHECKING:
    from hunt_ros.cli.support.processes import NodeSpec
    from hunt_ros.samples import Record

#: Estimates that are still under way when the last sample has been played.
_AFTER_S = 2.0
_PLAYER = 'live_replay'


def replay_live(arguments: argparse.Namespace, record: Record) -> int:
    """
    Play a recording to the nodes that run in this ROS graph; start a detector if none does.

    Raises
    ------
    HuntError
        If a rig publishes the same topics, or the recording fits no detector.
    """
    from hunt_ros.cli.support.processes import NodeSpec, Processes
    from hunt_ros.cli.support.suite import start_console
    from hunt_ros.cli.support.view import View

    detector = _detector(arguments, record)
    alone = True
    with (
        tempfile.TemporaryDirectory() as folder,
        View() as view,
        Processes(arguments.namespace or 'rig', Path(folder), private=False) as processes,
    ):
        link = start_console(processes)
        processes.start(NodeSpec(_PLAYER, _player(arguments)))
        ends: float | None = None
        while ends is None or time.monotonic() < ends:
            for line in link.lines(0.5):
                view.show(line)
                if line.get('listening') == 'False' and alone:
                    view.say('no node listens: starting a detector for this replay')
                    processes.start(detector)
                    alone = False
                if line.get('finished') == 'True' and ends is None:
                    ends = time.monotonic() + _AFTER_S
    return 0


def _player(arguments: argparse.Namespace) -> dict[str, object]:
    """Return the parameters of the node that plays."""
    return {
        'bag': str(arguments.bag.resolve()),
        'rate': 1.0 if arguments.pace is None else arguments.pace,
        'from_s': arguments.start or 0.0,
        'loop': arguments.loop,
        **({} if arguments.end is None else {'to_s': arguments.end}),
        **({'channels': tuple(arguments.channel)} if arguments.channel else {}),
    }


def _detector(arguments: argparse.Namespace, record: Record) -> NodeSpec:
    """Return the detector that fits the recording, for where none is running."""
    from hunt_ros.cli.support.processes import NodeSpec
    from hunt_ros.detection import DetectorConfig
    from hunt_ros.detection.offline import config_for

    config, _ = config_for(record, DetectorConfig())
    parameters: dict[str, object] = {
        'use_sim_time': True,
        'channels': config.channels,
    }
    for word in arguments.set:
        name, _, text = word.partition('=')
        parameters[name] = yaml.safe_load(text)
    files = [*arguments.rig, *([arguments.normal_form] if arguments.normal_form else [])]
    return NodeSpec('hunting_detector', parameters, files)
