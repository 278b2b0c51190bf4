"""
The web server of the page: one message an update for all viewers, and the operator's commands.

Which library, and why. Bokeh draws the figures: it brings its own front end (BokehJS, in the
wheel, so nothing is loaded from the internet) and tornado, which serves them. Its documents on
the server are not used: there is one a viewer, which is computed and encoded for each viewer
anew. The figures are laid out here once, in Python (`figures`), and the browser is sent only what
has changed since the view that it has (`view.changes`), encoded once for all who have it;
`make bench-page` says what that costs.

The server runs in a thread of its own. It is given each view by the node: where the node hangs
nothing is sent, and each page says by itself that it is out of date.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from importlib.resources import files
from pathlib import Path
from typing import Any

import tornado.escape
import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket
from bokeh.util.paths import bokehjs_path

from hunt_ros.dashboard.access import COMMAND, VIEW, Access, same_origin
from hunt_ros.dashboard.comparison import compare
from hunt_ros.dashboard.figures import figure_items
from hunt_ros.dashboard.recordings import GONE, Recordings
from hunt_ros.dashboard.view import View, changes
from hunt_ros.errors import ConfigError
from hunt_ros.report.figures.style import palette_css

#: A viewer that has not taken an update for so long is dropped, s.
_STALLED_S = 3.0
_MOST_VIEWERS = 40
#: Each is a process with the numerics of a detector.
_MOST_REPLAYS = 4
#: The viewer of a replay hears so often how the rig is now, and that the server is there, s.
_HEARTBEAT_S = 0.25
#: The first picture of a replay is its longest line, bytes.
_LONGEST_LINE = 2**24
#: After a wrong token, s: trying all of them takes for ever.
_WRONG_TOKEN_S = 1.0
#: A browser keeps its cookie so long. The right in it ends with the session (`session_s`), but for
#: the emergency stop: who could command may stop the rig, also after a night, for to refuse that
#: may do harm, and to stop can do none. To rearm, as for all else, one has to sign in again.
_COOKIE_DAYS = 30.0
SESSION_S = 12 * 3600.0
#: A command is a word and a few more.
_MOST_BYTES = 4096
_STATIC = files('hunt_ros.dashboard') / 'static'
_KINDS = {'html': 'text/html', 'js': 'text/javascript', 'css': 'text/css'}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline';"
    " img-src 'self' data: blob:; connect-src 'self'; font-src 'self'; form-action 'self';"
    " base-uri 'none'; frame-ancestors 'none'"
)

#: Gets the word of a command and the words that go with it; the answer is (done, message).
Command = Callable[[str, str], 'Future[tuple[bool, str]]']


class PageServer:
    """
    Serves the page in a thread, from now until it is closed.

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
    session_s : float
        How long after a token was typed it lets this browser view or command.

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
        session_s: float = SESSION_S,
    ) -> None:
        try:
            self._sockets = tornado.netutil.bind_sockets(port, address)
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno else str(error)
            raise ConfigError(
                f'the page cannot be served at {address}, port {port} ({reason}): choose another'
                ' with the parameters address and port'
            ) from error
        self.port = int(self._sockets[0].getsockname()[1])
        self.access = access
        self.command = command
        self.title = title
        self.recordings = recordings
        self.session_s = session_s
        self.pages = {path.name: path.read_bytes() for path in _STATIC.iterdir() if path.is_file()}
        self.pages['figures.json'] = figure_items()
        self.pages['colours.css'] = (
            f':root {{ {palette_css(dark=False)} }}\n'
            f':root[data-scheme="night"] {{ {palette_css(dark=True)} }}\n'
        ).encode()
        whole = b''.join(content for _, content in sorted(self.pages.items()))
        #: A page of another version reloads itself.
        self.version = hashlib.sha256(whole).hexdigest()[:12]
        self.viewers: set[_Viewer] = set()
        self.replays: set[_Replay] = set()
        self.dropped = 0
        self.failure = ''
        self._view = View()
        self._encoded: dict[int, bytes] = {}
        self._before: dict[int, View] = {}
        self._loop = asyncio.new_event_loop()
        started: Future[None] = Future()
        self._thread = threading.Thread(
            target=self._run, args=(started,), name='page', daemon=True
        )
        self._thread.start()
        started.result()

    @property
    def count(self) -> int:
        """How many viewers there are."""
        return len(self.viewers)

    def publish(self, view: View) -> None:
        """Send every viewer what has changed; from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._send, view)

    def close(self) -> None:
        """End the connections and the thread."""
        self.recordings.close()
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2.0)

    def _run(self, started: Future[None]) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._begin())
        except BaseException as error:
            started.set_exception(error)
            return
        started.set_result(None)
        try:
            self._loop.run_forever()
            played = [replay.task for replay in self.replays]
            open_pages: list[_Viewer | _Replay] = [*self.viewers, *self.replays]
            for viewer in open_pages:
                viewer.close(1001, 'the server ends')
                viewer.on_close()
            if played:  # their processes are being killed
                self._loop.run_until_complete(asyncio.wait(played, timeout=2.0))
            self._loop.run_until_complete(asyncio.sleep(0.05))
        finally:
            self._loop.close()
            for each in self._sockets:
                each.close()

    async def _begin(self) -> None:
        application = tornado.web.Application(
            [
                (r'/', _Page, {'name': 'index.html'}),
                (r'/replay', _Page, {'name': 'index.html'}),
                (r'/played', _Replay),
                (r'/recordings', _Page, {'name': 'recordings.html'}),
                (r'/recordings\.json', _Listing),
                (r'/comparison\.json', _Comparison),
                (r'/report/([^/]+)', _Report),
                (
                    r'/(page\.js|recordings\.js|login\.js|page\.css|colours\.css|figures\.json)',
                    _Static,
                ),
                (r'/bokeh\.js', _Bokeh),
                (r'/login', _Login),
                (r'/session', _Session),
                (r'/live', _Viewer),
                (r'/command', _Command),
            ],
            cookie_secret=self.access.secret,
            websocket_ping_interval=5,
            websocket_max_message_size=_MOST_BYTES,
            log_function=lambda handler: None,
            page=self,
        )
        server = tornado.httpserver.HTTPServer(application, max_body_size=_MOST_BYTES)
        server.add_sockets(self._sockets)

    def _send(self, view: View) -> None:
        """Send each viewer the difference to what it has; in the thread of the loop."""
        self._view = view
        self._encoded.clear()
        self._before.clear()
        for viewer in list(self.viewers):
            viewer.update(view)

    def encoded(self, before: View, view: View) -> bytes:
        """Return the difference between two views as the page gets it."""
        key = id(before)
        if key not in self._encoded or self._before[key] is not before:
            self._before[key] = before  # kept alive: its id is its name
            text = json.dumps(changes(before, view), allow_nan=False, separators=(',', ':'))
            self._encoded[key] = text.encode()
        return self._encoded[key]

    @property
    def view(self) -> View:
        """What was published last."""
        return self._view


class _Handler(tornado.web.RequestHandler):
    """What all requests have in common: host, rights, headers."""

    @property
    def page(self) -> PageServer:
        page: PageServer = self.settings['page']
        return page

    def set_default_headers(self) -> None:
        self.set_header('Content-Security-Policy', _POLICY)
        self.set_header('X-Content-Type-Options', 'nosniff')
        # With no-referrer a browser says `Origin: null` with the form for a token.
        self.set_header('Referrer-Policy', 'same-origin')
        self.set_header('Cache-Control', 'no-cache')
        self.set_header('Server', 'hunt_ros')

    def prepare(self) -> None:
        if not self.page.access.knows_host(self.request.host):
            self.refuse(403, f'{self.request.host[:80]!r} is not a name of this machine')
        elif not same_origin(self.request.headers.get('Origin'), self.request.host):
            self.refuse(403, 'a page of another site asked for this')

    @property
    def cookie(self) -> str:
        """Name of the cookie: those of all ports of a host are sent together."""
        return f'hunt_ros_{self.page.port}'

    @property
    def right(self) -> str:
        """What this browser may do: '', 'view' or 'command'."""
        if not self.page.access.tokens:
            return COMMAND
        right, typed_s = self._signed_in()
        return right if time.time() < typed_s + self.page.session_s else ''

    @property
    def may_stop(self) -> bool:
        """Whether this browser may stop the rig: also where its session has ended."""
        return self.right == COMMAND or self._signed_in()[0] == COMMAND

    @property
    def ended(self) -> str:
        """One line where there was a session, and it has ended; else ''."""
        if self.right or not self._signed_in()[0]:
            return ''
        hours = f'{self.page.session_s / 3600.0:.3g} h'
        return f'The session has ended, {hours} after the token was typed: sign in again'

    def _signed_in(self) -> tuple[str, float]:
        """Return the right of the cookie, and when its token was typed, s; ('', 0) without one."""
        value = self.get_signed_cookie(self.cookie, max_age_days=_COOKIE_DAYS) or b''
        right, _, typed_s = value.decode().partition(' ')
        return (right, float(typed_s)) if right in (VIEW, COMMAND) and typed_s else ('', 0.0)

    def refuse(self, code: int, why: str) -> None:
        """End the request with one line."""
        self.set_status(code)
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps({'done': False, 'message': why}))

    def write_error(self, status_code: int, **keywords: Any) -> None:
        self.refuse(status_code, self._reason)


class _Page(_Handler):
    """One of the two pages, or the form for a token where one is needed."""

    def initialize(self, name: str) -> None:
        self._name = name

    def get(self) -> None:
        name = self._name if self.right else 'login.html'
        said = self.ended or (
            'This is none of the tokens' if 'wrong' in self.request.query else ''
        )
        text = self.page.pages[name].decode()
        text = text.replace('{{version}}', self.page.version).replace(
            '{{title}}', tornado.escape.xhtml_escape(self.page.title)
        )
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        text = text.replace('{{said}}', tornado.escape.xhtml_escape(said))
        text = text.replace('{{stop}}', '' if self.may_stop else 'hidden')
        self.finish(text.replace('{{right}}', self.right))


class _Session(_Handler):
    """What this browser may do now, for a page that has lost its connection."""

    def get(self) -> None:
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps({'right': self.right, 'message': self.ended}))


class _Listing(_Handler):
    """The recordings, as they are now."""

    async def get(self) -> None:
        if not self.right:
            self.refuse(401, 'a token is needed')
            return
        # Not in the thread of the live page: a folder on a slow disk may take its time.
        loop = asyncio.get_running_loop()
        listing = await loop.run_in_executor(None, self.page.recordings.listing)
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps(listing, allow_nan=False))


class _Comparison(_Handler):
    """The recordings that are chosen, side by side."""

    async def get(self) -> None:
        if not self.right:
            self.refuse(401, 'a token is needed')
            return
        names = set(self.get_arguments('recording', strip=False))
        dark = self.get_argument('scheme', '') == 'night'
        answer = await asyncio.get_running_loop().run_in_executor(None, self._compare, names, dark)
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps(answer, allow_nan=False))

    def _compare(self, names: set[str], dark: bool) -> dict[str, Any]:
        recordings = self.page.recordings
        listing = recordings.listing()
        rows = [row for row in listing['recordings'] if row['name'] in names]
        found = compare(rows, recordings.directory, dark)
        gone = [row['name'] for row in rows if row['state'] == 'gone']
        gone += sorted(names - {row['name'] for row in rows})
        if gone:
            found['problem'] = f'{", ".join(gone)}: {GONE}'
            found['without'] = [name for name in found['without'] if name not in gone]
        return found


class _Report(_Handler):
    """The report of a recording."""

    async def get(self, name: str) -> None:
        if not self.right:
            self.refuse(401, 'a token is needed')
            return
        loop = asyncio.get_running_loop()
        path = await loop.run_in_executor(None, self.page.recordings.report, name)
        try:
            if path is None:
                raise FileNotFoundError
            content = await loop.run_in_executor(None, path.read_bytes)
        except OSError:
            self.refuse(404, f'there is no report of {name[:80]}')
            return
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        self.finish(content)


class _Static(_Handler):
    """Scripts, styles and figures: nothing secret."""

    def get(self, name: str) -> None:
        kind = _KINDS.get(name.rpartition('.')[2], 'application/json')
        self.set_header('Content-Type', f'{kind}; charset=utf-8')
        self.finish(self.page.pages[name])


class _Bokeh(_Handler):
    """BokehJS as it comes with the wheel."""

    def get(self) -> None:
        self.set_header('Content-Type', 'text/javascript; charset=utf-8')
        self.finish((Path(bokehjs_path()) / 'js' / 'bokeh.min.js').read_bytes())


class _Login(_Handler):
    """Takes a token, and gives a cookie for it."""

    async def post(self) -> None:
        right = self.page.access.right_of(self.get_body_argument('token', ''))
        if not right:
            await asyncio.sleep(_WRONG_TOKEN_S)
            self.redirect('/?wrong', status=303)
            return
        self.set_signed_cookie(
            self.cookie,
            f'{right} {time.time():.0f}',
            expires_days=_COOKIE_DAYS,
            httponly=True,
            samesite='Strict',
        )
        self.redirect('/', status=303)


class _Command(_Handler):
    """Does what an operator asks for, and answers when it is done."""

    async def post(self) -> None:
        # A form of another site cannot send this type, even where Origin is missing.
        if self.request.headers.get('Content-Type', '').partition(';')[0] != 'application/json':
            self.refuse(415, 'expected application/json')
            return
        try:
            asked = json.loads(self.request.body)
            word, words = asked['word'], asked.get('words', '')
        except (ValueError, KeyError, TypeError, AttributeError):
            self.refuse(400, 'expected {"word": ..., "words": ...}')
            return
        if not (isinstance(word, str) and isinstance(words, str)):
            self.refuse(400, 'expected texts')
            return
        if self.right != COMMAND and not (word == 'emergency-stop' and self.may_stop):
            told = 'this browser may view only: commands need the other token'
            self.refuse(401 if self.ended else 403, self.ended or told)
            return
        done, message = await asyncio.wrap_future(self.page.command(word, words))
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps({'done': done, 'message': message}))


class _Viewer(_Handler, tornado.websocket.WebSocketHandler):
    """One open page."""

    def prepare(self) -> None:
        super().prepare()
        if self._finished:
            return
        if not self.right:
            self.refuse(401, 'a token is needed')
        elif self.page.count >= _MOST_VIEWERS:
            self.refuse(503, f'{_MOST_VIEWERS} pages are open already')

    def check_origin(self, origin: str) -> bool:
        return same_origin(origin, self.request.host)

    def open(self, *arguments: str, **keywords: str) -> None:
        self._has = View()
        self._delivery: asyncio.Future[None] | None = None
        self._since_s = time.monotonic()
        self.page.viewers.add(self)
        about = {'version': self.page.version, 'right': self.right}
        self.write_message(json.dumps({'about': about}))
        self.update(self.page.view)

    def on_message(self, message: str | bytes) -> None:
        """Ignore it: commands come by another way."""

    def on_close(self) -> None:
        self.page.viewers.discard(self)

    def update(self, view: View) -> None:
        """Send what has changed, unless the last update is still on its way."""
        if not self.right:
            self.page.viewers.discard(self)
            self.close(1008, 'the session has ended')
            return
        now_s = time.monotonic()
        if self._delivery is not None and not self._delivery.done():
            if now_s - self._since_s > _STALLED_S:
                self._drop()
        elif view.sections:
            data = self.page.encoded(self._has, view)
            self._has, self._since_s = view, now_s
            self._delivery = asyncio.ensure_future(self._deliver(data))

    async def _deliver(self, data: bytes) -> None:
        """Send a text that is encoded already; done when the system has taken it."""
        with contextlib.suppress(tornado.websocket.WebSocketClosedError):
            await self.write_message(data)

    def _drop(self) -> None:
        """Cut the connection of a viewer that takes nothing; its page comes back by itself."""
        self.page.dropped += 1
        self.page.viewers.discard(self)
        self.close(1008, 'stalled')  # which it will not take either: tornado cuts it soon


class _Replay(_Handler, tornado.websocket.WebSocketHandler):
    """
    A page that shows a recording: what a process of its own plays (`player`), and the rig now.

    The process ends with the connection. A page that takes its updates slowly slows its own
    replay down, and nothing else.
    """

    def prepare(self) -> None:
        super().prepare()
        if self._finished:
            return
        if not self.right:
            self.refuse(401, 'a token is needed')

    def check_origin(self, origin: str) -> bool:
        return same_origin(origin, self.request.host)

    def open(self, *arguments: str, **keywords: str) -> None:
        self._child: asyncio.subprocess.Process | None = None
        self._closed = False
        about = {'version': self.page.version, 'right': self.right}
        self.write_message(json.dumps({'about': about}))
        self.task = asyncio.ensure_future(self._play(self.get_argument('recording', '')))

    def on_message(self, message: str | bytes) -> None:
        """Hand an order of the viewer on."""
        order = _order(message)
        if order and self._child is not None and self._child.stdin is not None:
            self._child.stdin.write(json.dumps(order).encode() + b'\n')

    def on_close(self) -> None:
        self._closed = True
        self.page.replays.discard(self)
        if self._child is not None:
            with contextlib.suppress(ProcessLookupError):
                self._child.kill()

    async def _play(self, name: str) -> None:
        """Send what the process prints, until it ends or nobody looks any more."""
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(None, self.page.recordings.to_play, name)
        if found is None:
            await self._fail(name, GONE)
        elif len(self.page.replays) >= _MOST_REPLAYS:
            await self._fail(name, f'{_MOST_REPLAYS} replays run already: close one of them')
        elif not self._closed:
            self.page.replays.add(self)
            said = await self._run(found)
            if said and not self._closed:
                await self._fail(name, f'the replay has ended: {said}')

    async def _run(self, found: Mapping[str, str]) -> str:
        """Play a recording; return why the process ended, '' where it has said so itself."""
        order = {**found, **_order(self.get_argument('order', ''))}
        self._child = child = await asyncio.create_subprocess_exec(
            sys.executable, '-m', 'hunt_ros.dashboard.player',
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE, limit=_LONGEST_LINE,
        )  # fmt: skip
        assert child.stdin is not None
        assert child.stdout is not None
        assert child.stderr is not None
        if self._closed:
            child.kill()
        child.stdin.write(json.dumps(order).encode() + b'\n')
        wrong = asyncio.ensure_future(child.stderr.read())
        reading = asyncio.ensure_future(child.stdout.readline())
        told_s = 0.0
        while True:
            done, _ = await asyncio.wait({reading}, timeout=_HEARTBEAT_S)
            line = reading.result() if done else b''
            if done and not line:
                break
            if time.monotonic() - told_s >= _HEARTBEAT_S:
                told_s = time.monotonic()
                if not self.right:
                    self.close(1008, 'the session has ended')  # which ends the process
                await self._send(self._present())
            if done:
                await self._send(line)
                reading = asyncio.ensure_future(child.stdout.readline())
        await child.wait()
        last = (await wrong).decode(errors='replace').strip().splitlines()
        if not child.returncode:
            return ''
        return last[-1] if last else f'exit code {child.returncode}'

    def _present(self) -> bytes:
        """Return what is true of the rig now, beside the recording."""
        now = self.page.view.sections.get('status')
        live = now.data if now is not None else None
        return json.dumps({'sections': {'now': live}, 'streams': {}}).encode()

    async def _send(self, data: bytes) -> None:
        with contextlib.suppress(tornado.websocket.WebSocketClosedError):
            await self.write_message(data)

    async def _fail(self, name: str, why: str) -> None:
        """Say why there is nothing, or nothing more; the page does not try again by itself."""
        failed = {'name': name[:200], 'problem': why, 'reading': False}
        await self._send(json.dumps({'sections': {'replay': failed}, 'streams': {}}).encode())


_ORDERS = ('rate', 'playing', 'at_s')


def _order(message: str | bytes) -> dict[str, float | bool]:
    """Return what a viewer orders of its replay; {} where that is nothing of the kind."""
    try:
        asked = json.loads(message)
        return {
            name: bool(asked[name]) if name == 'playing' else float(asked[name])
            for name in _ORDERS
            if name in asked and math.isfinite(float(asked[name]))
        }
    except (ValueError, TypeError, KeyError):
        return {}
