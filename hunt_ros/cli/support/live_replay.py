"""`hunt replay --live`: the recording on the topics of the rig, events as they come."""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from hunt_ros.cli.support import options
from hunt_ros.cli.support.console import Console
from hunt_ros.cli.support.processes import NodeSpec
from hunt_ros.cli.support.suite import start_nodes, start_page
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.cli.support.view import View
from hunt_ros.detection import DetectorConfig
from hunt_ros.detection.offline import config_for
from hunt_ros.samples import CHANNELS, Record
from hunt_ros.settings import Settings
from hunt_ros.suite import PAGE

#: Estimates that are still under way when the last sample has been played.
_AFTER_S = 2.0


def replay_live(
    arguments: argparse.Namespace, record: Record, settings: Iterable[Settings]
) -> int:
    """
    Play a recording to the nodes that run in this ROS graph; start a detector if none does.

    Parameters
    ----------
    arguments : Namespace
        Of `hunt replay`.
    record : Record
        The recording.
    settings : iterable of Settings
        Of the detector, as `--set` asks for them.

    Raises
    ------
    HuntError
        If a rig publishes the same topics, or the recording fits no detector.
    """
    detector = _detector(arguments, record, settings)
    begun, played, ends = False, False, math.inf
    namespace, page = arguments.namespace or 'rig', arguments.page
    with (
        tempfile.TemporaryDirectory() as folder,
        View(namespace, options.rig_of(arguments).speed_unit) as view,
        Supervisor(namespace, Path(folder), private=False, keep=False) as supervisor,
    ):
        console = Console(supervisor, view)
        supervisor.start(NodeSpec('live_replay', _player(arguments)))
        while time.monotonic() < ends:
            for line in console.lines(0.5):
                if not begun and {'listening', 'finished'} & line.keys():
                    begun = True
                    if line.get('listening') == 'False':
                        view.say('no node listens: starting a detector for this replay')
                        own = {'hunting_detector': detector}
                        start_nodes(supervisor, [*own], {}, own, _files(arguments))
                    if page is not None:
                        beside = arguments.bag.resolve().parent
                        view.say(start_page(supervisor, page, beside, {}, _files(arguments)))
                if line.get('finished') == 'True' and not played:
                    played = True
                    if PAGE not in supervisor.pids():  # none was asked for, or its port is taken
                        ends = time.monotonic() + _AFTER_S
                    else:
                        view.say('the recording has been played; Ctrl-C ends the page')
    return 0


def _player(arguments: argparse.Namespace) -> dict[str, object]:
    """Return the parameters of the node that plays."""
    sources = options.channels_of(arguments, CHANNELS)
    return {
        'bag': str(arguments.bag.resolve()),
        'rate': arguments.pace or 1.0,
        'from_s': arguments.start or 0.0,
        **({} if arguments.end is None else {'to_s': arguments.end}),
        **({'channels': tuple(map(str, sources.values()))} if sources else {}),
    }


def _detector(
    arguments: argparse.Namespace, record: Record, settings: Iterable[Settings]
) -> dict[str, object]:
    """Return the parameters of a detector that fits the recording, for where none is running."""
    config, _ = config_for(record, DetectorConfig())
    given = {name: value for kind in settings for name, value in vars(kind).items()}
    asked = {name: given[name] for _, name, _ in arguments.set}
    return {'use_sim_time': True, 'channels': config.channels, **asked}


def _files(arguments: argparse.Namespace) -> list[Path]:
    return [*arguments.rig, *([arguments.normal_form] if arguments.normal_form else [])]
