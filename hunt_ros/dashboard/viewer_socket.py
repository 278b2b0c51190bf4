"""The connection of a page that shows the rig as it is."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time

import tornado.websocket

from hunt_ros.dashboard.access import same_origin
from hunt_ros.dashboard.handlers import Handler
from hunt_ros.dashboard.view import View

#: A viewer that has not taken an update for so long is dropped, s.
_STALLED_S = 3.0
_MOST_VIEWERS = 40


class ViewerSocket(Handler, tornado.websocket.WebSocketHandler):
    """One open page."""

    def prepare(self) -> None:
        """Refuse who has not signed in, and one page too many."""
        super().prepare()
        if not self._finished and not self.right:
            self.refuse(401, 'a token is needed')
        if not self._finished and len(self.site.live.viewers) >= _MOST_VIEWERS:
            self.refuse(503, f'{_MOST_VIEWERS} pages are open already')

    def check_origin(self, origin: str) -> bool:
        """Return False for a page of another site."""
        return same_origin(origin, self.request.host)

    def open(self, *arguments: str, **keywords: str) -> None:
        """Say who this is, and show the present view."""
        self._has = View()
        self._delivery: asyncio.Future[None] | None = None
        self._since_s = time.monotonic()
        self.site.live.viewers.add(self)
        about = {'version': self.site.version, 'right': self.right}
        self.write_message(json.dumps({'about': about}))
        self.update(self.site.live.view)

    def on_message(self, message: str | bytes) -> None:
        """Ignore it: commands come by another way."""

    def on_close(self) -> None:
        """Send it nothing more."""
        self.site.live.viewers.discard(self)

    def update(self, view: View) -> None:
        """Send what has changed, unless the last update is still on its way."""
        if not self.right:
            self.site.live.viewers.discard(self)
            self.close(1008, 'the session has ended')
            return
        now_s = time.monotonic()
        if self._delivery is not None and not self._delivery.done():
            if now_s - self._since_s > _STALLED_S:
                self._drop()
        elif view.sections:
            data = self.site.live.since(self._has)
            self._has, self._since_s = view, now_s
            self._delivery = asyncio.ensure_future(self._deliver(data))

    async def _deliver(self, data: bytes) -> None:
        """Send a text that is encoded already; done when the system has taken it."""
        with contextlib.suppress(tornado.websocket.WebSocketClosedError):
            await self.write_message(data)

    def _drop(self) -> None:
        """Cut the connection of a viewer that takes nothing; its page comes back by itself."""
        self.site.live.dropped += 1
        self.site.live.viewers.discard(self)
        self.close(1008, 'stalled')  # which it will not take either: tornado cuts it soon
