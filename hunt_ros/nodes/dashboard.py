"""
The node of the operator's page: topics into the model, the model to the browsers, and back.

It only listens, and calls the services that an operator asks for. Messages are taken many at a
time, once an update; the web server has a thread of its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from std_msgs.msg import String

from hunt_ros.dashboard.access import access
from hunt_ros.dashboard.model import PageModel, PageSettings
from hunt_ros.dashboard.recordings import Recordings
from hunt_ros.dashboard.server import PageServer
from hunt_ros.dashboard.words import Words
from hunt_ros.nodes.support.caller import Caller
from hunt_ros.nodes.support.conversions import message_class, read_diagnostic, to_ns
from hunt_ros.nodes.support.diagnostics import Health, steady_clock
from hunt_ros.nodes.support.hearing import Channels, waiting
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare, declare_normal_form
from hunt_ros.nodes.support.qos import TOPICS
from hunt_ros.samples import counted
from hunt_ros.sensors import DISPLACEMENTS
from hunt_ros.settings import Settings, setting
from hunt_ros.suite import PAGE_PORT

#: Updates of the page, s.
_UPDATE_S = 0.05


@dataclass(frozen=True)
class DashboardConfig(Settings):
    """Parameters of the node; those of the picture are `PageSettings`."""

    address: str = setting(
        '127.0.0.1', 'Where the page is served; another than the loopback needs token_file.'
    )
    port: int = setting(PAGE_PORT, 'TCP port of the page; 0: a free one.', low=0, high=65535)
    token_file: str = setting(
        '', 'File with the lines "view: TOKEN" and "command: TOKEN", mode 600.'
    )
    directory: str = setting('./recordings', 'Folder of the recordings on the second page.')


class DashboardNode(SuiteNode):
    """Serves the page."""

    def __init__(self) -> None:
        super().__init__('dashboard')
        config = declare(self, DashboardConfig)
        settings = declare(self, PageSettings)
        form = declare_normal_form(self)
        # First what may be refused: no thread runs yet.
        self._server = PageServer(
            config.address,
            config.port,
            access(config.address, config.token_file),
            lambda word, words: self._caller.call(word, words),
            self.get_namespace().strip('/') or 'rig',
            Recordings(Path(config.directory).expanduser().absolute()),
            Words(settings.speed_unit),
        )
        self._model = PageModel(settings, form, self.get_namespace())
        self._inbox = Channels(self, DISPLACEMENTS)
        model, now = self._model, time.monotonic
        takers: dict[str, Callable[..., None]] = {
            'hunting/status': lambda at_ns, said: model.take_status(at_ns, said, now()),
            'hunting/events': model.take_event,
            '/diagnostics': lambda _, said: model.take_health(said, now()),
            'speed/status': lambda _, said: model.take_speed_status(said, now()),
            'hunting/alarms': model.take_alarms,
            'hunting/normal_form': self._take_form,
            'recording/mark': model.take_mark,
        }
        self._heard = []
        for topic, take in takers.items():
            kind, quality = TOPICS[topic]
            subscription = self.create_polled_subscription(message_class(kind), topic, quality)
            self._heard.append((subscription, take))
        self._caller = Caller(self)
        host = f'[{config.address}]' if ':' in config.address else config.address
        self._url = f'http://{host}:{self._server.site.port}/'
        self.get_logger().info(f'the page is at {self._url}')
        self.create_timer(_UPDATE_S, self._update, clock=steady_clock())

    def close(self) -> None:
        """End the server."""
        self._server.close()
        self._caller.close()
        super().close()

    def _update(self) -> None:
        """Take what has come, and send what it makes of the page."""
        for channel, stamps_ns, values, _ in self._inbox.take():
            self._model.take_samples(channel, stamps_ns, values)
        for subscription, take in self._heard:
            for message, _ in waiting(subscription):
                if isinstance(message, String):
                    take(message.data)
                else:
                    take(to_ns(message.header.stamp), read_diagnostic(message))
        self._model.take_viewers(len(self._server.site.live.viewers))
        self._server.publish(self._model.view(time.monotonic()))

    def _take_form(self, text: str) -> None:
        if problem := self._model.take_form(text):
            self.get_logger().error(problem)

    def _health(self) -> Health:
        values = {
            'url': self._url,
            'viewers': len(self._server.site.live.viewers),
            'stalled_viewers': self._server.site.live.dropped,
            'received': self._inbox.received,
        }
        if problem := self._inbox.problem():
            return 'WARN', problem, values
        count = len(self._server.site.live.viewers)
        return 'OK', f'{counted(count, "viewer")} at {self._url}', values


make_node = DashboardNode
