"""`hunt replay --live`: the recording on the topics of the rig, events as they come."""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from hunt_ros.cli.support import options
from hunt_ros.compiled import compile_all
from hunt_ros.samples import CHANNELS
from hunt_ros.suite import PAGE, PAGE_PORT

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
    from hunt_ros.cli.support.console_link import ConsoleLink
    from hunt_ros.cli.support.processes import NodeSpec
    from hunt_ros.cli.support.suite import start_nodes
    from hunt_ros.cli.support.supervisor import Supervisor
    from hunt_ros.cli.support.view import View

    detector = _detector(arguments, record)
    compile_all()  # before the recording runs: a node compiles nothing
    begun = False
    namespace = arguments.namespace or 'rig'
    with (
        tempfile.TemporaryDirectory() as folder,
        View(namespace) as view,
        Supervisor(namespace, Path(folder), private=False, keep=False) as supervisor,
    ):
        link = ConsoleLink(supervisor)
        supervisor.start(NodeSpec(_PLAYER, _player(arguments)))
        ends: float | None = None
        while ends is None or time.monotonic() < ends:
            for line in link.lines(0.5):
                view.show(line)
                if not begun and {'listening', 'finished'} & line.keys():
                    begun = True
                    if line.get('listening') == 'False':
                        view.say('no node listens: starting a detector for this replay')
                        supervisor.start(detector)
                    if arguments.page is not None:
                        port = arguments.page or PAGE_PORT
                        own = {
                            PAGE: {'port': port, 'directory': str(arguments.bag.resolve().parent)}
                        }
                        files = _files(arguments)
                        start_nodes(supervisor, [PAGE], {}, own, files)
                        view.say(f'page: http://127.0.0.1:{port}/')
                if line.get('finished') == 'True' and ends is None:
                    after_s = _AFTER_S if arguments.page is None else math.inf
                    ends = time.monotonic() + after_s
                    if arguments.page is not None:
                        view.say('the recording has been played; Ctrl-C ends the page')
    return 0


def _player(arguments: argparse.Namespace) -> dict[str, object]:
    """Return the parameters of the node that plays."""
    sources = options.channels_of(arguments, CHANNELS)
    return {
        'bag': str(arguments.bag.resolve()),
        'rate': 1.0 if arguments.pace is None else arguments.pace,
        'from_s': arguments.start or 0.0,
        'loop': arguments.loop,
        **({} if arguments.end is None else {'to_s': arguments.end}),
        **({'channels': tuple(map(str, sources.values()))} if sources else {}),
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
    return NodeSpec('hunting_detector', parameters, _files(arguments))


def _files(arguments: argparse.Namespace) -> list[Path]:
    return [*arguments.rig, *([arguments.normal_form] if arguments.normal_form else [])]
