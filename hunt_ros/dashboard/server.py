"""
The web server of the page: one message an update for all viewers, and the operator's commands.

The browser is sent only what has changed since the view that it has (`view.changes`), encoded once
for all who have it. uPlot draws the figures there: one file of 51 kB that stands beside the page
(`static/uplot`).

The server runs in a thread of its own. It is given each view by the node: where the node hangs
nothing is sent, and each page says by itself that it is out of date.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from concurrent.futures import Future
from typing import Any

import tornado.httpserver
import tornado.netutil
import tornado.web

from hunt_ros.dashboard import handlers
from hunt_ros.dashboard.access import Access
from hunt_ros.dashboard.recordings import Recordings
from hunt_ros.dashboard.site import Command, Site
from hunt_ros.dashboard.view import View
from hunt_ros.dashboard.viewer_socket import ViewerSocket
from hunt_ros.dashboard.words import Words
from hunt_ros.errors import ConfigError

#: A command is a word and a few more.
_MOST_BYTES = 4096
#: A connection on which nothing is asked for is closed after this, s.
_IDLE_S = 60.0
_ROUTES: list[Any] = [
    (r'/', handlers.PageHandler, {'name': 'index'}),
    (r'/recordings', handlers.PageHandler, {'name': 'recordings'}),
    (r'/recordings\.json', handlers.FolderHandler),
    (r'/(?:report|form)/([^/]+)', handlers.FolderHandler),
    (r'/file/([^/]+)/([^/]+)', handlers.FolderHandler),
    (r'/([a-zA-Z.]+\.(?:js|css))', handlers.StaticHandler),
    (r'/login', handlers.LoginHandler),
    (r'/session', handlers.SessionHandler),
    (r'/live', ViewerSocket),
    (r'/command', handlers.CommandHandler),
]


class PageServer:
    """
    Serves the page in a thread, from now until it is closed.

    `site` is what it serves; its `live` pages are those of the thread of the server.

    Parameters
    ----------
    address : str
        Of the interface.
    port : int
        TCP port; 0: one that is free.
    access : Access
        Who may do what.
    command : callable
        Does what an operator asks for; called in the thread of the server.
    title : str
        Of the page: the name of the rig.
    recordings : Recordings
        What the second page shows.
    words : Words
        In which answers are told.

    Raises
    ------
    ConfigError
        If the port is in use, or the address is none of this machine.
    """

    def __init__(
        self,
        address: str,
        port: int,
        access: Access,
        command: Command,
        title: str,
        recordings: Recordings,
        words: Words = Words(),  # noqa: B008 - it never changes
    ) -> None:
        try:
            self._sockets = tornado.netutil.bind_sockets(port, address)
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno else str(error)
            raise ConfigError(
                f'the page cannot be served at {address}, port {port} ({reason}): choose another'
                ' with --page PORT, or with the parameters address and port'
            ) from error
        port = int(self._sockets[0].getsockname()[1])
        self.site = Site(port, access, command, title, recordings, words)
        self._loop = asyncio.new_event_loop()
        started: Future[None] = Future()
        self._thread = threading.Thread(
            target=self._run, args=(started,), name='page', daemon=True
        )
        self._thread.start()
        started.result()

    def publish(self, view: View) -> None:
        """Send every viewer what has changed; from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self.site.live.publish, view)

    def close(self) -> None:
        """End the connections and the thread."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2.0)

    def _run(self, started: Future[None]) -> None:
        """Serve until the loop is stopped (in the thread of the server)."""
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._begin())
        except BaseException as error:
            started.set_exception(error)
            return
        started.set_result(None)
        try:
            self._loop.run_forever()
            self._end_pages()
        finally:
            self._loop.close()
            for each in self._sockets:
                each.close()

    def _end_pages(self) -> None:
        """End every open page, and what is left."""
        for page in list(self.site.live.viewers):
            page.close(1001, 'the server ends')
            page.on_close()
        self._loop.run_until_complete(self._end_requests())
        left = asyncio.all_tasks(self._loop)
        for task in left:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))

    async def _end_requests(self) -> None:
        """Close what browsers keep open for their next request: they would wait for an answer."""
        await asyncio.sleep(0.05)
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._http.close_all_connections(), 1.0)

    async def _begin(self) -> None:
        """Listen on the sockets; in the loop."""
        application = tornado.web.Application(
            _ROUTES,
            cookie_secret=self.site.access.secret,
            websocket_ping_interval=5,
            websocket_max_message_size=_MOST_BYTES,
            log_function=lambda handler: None,
            default_handler_class=handlers.NothingHandler,
            compress_response=True,
            site=self.site,
        )
        self._http = tornado.httpserver.HTTPServer(
            application, max_body_size=_MOST_BYTES, idle_connection_timeout=_IDLE_S
        )
        self._http.add_sockets(self._sockets)
