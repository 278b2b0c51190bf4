"""What the server answers, request by request: rights, pages, files and commands."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path
from typing import Any

import tornado.escape
import tornado.web
import tornado.websocket
from bokeh.util.paths import bokehjs_path

from hunt_ros.dashboard.access import COMMAND, VIEW, same_origin
from hunt_ros.dashboard.comparison import compare
from hunt_ros.dashboard.recordings import GONE
from hunt_ros.dashboard.site import Site

#: After a wrong token, s: trying all of them takes for ever.
_WRONG_TOKEN_S = 1.0
#: A browser keeps its cookie so long. The right in it ends with the session (`session_s`), but for
#: the emergency stop: who could command may stop the rig, also after a night, for to refuse that
#: may do harm, and to stop can do none. To rearm, as for all else, one has to sign in again.
_COOKIE_DAYS = 30.0
_KINDS = {'html': 'text/html', 'js': 'text/javascript', 'css': 'text/css'}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline';"
    " img-src 'self' data: blob:; connect-src 'self'; font-src 'self'; form-action 'self';"
    " base-uri 'none'; frame-ancestors 'none'"
)


class Handler(tornado.web.RequestHandler):
    """What all requests have in common: host, rights, headers."""

    @property
    def site(self) -> Site:
        """What is served, and to whom."""
        site: Site = self.settings['site']
        return site

    def set_default_headers(self) -> None:
        """Let a page load nothing of another site, and be framed by none."""
        self.set_header('Content-Security-Policy', _POLICY)
        self.set_header('X-Content-Type-Options', 'nosniff')
        # With no-referrer a browser says `Origin: null` with the form for a token.
        self.set_header('Referrer-Policy', 'same-origin')
        self.set_header('Cache-Control', 'no-cache')
        self.set_header('Server', 'hunt_ros')

    def prepare(self) -> None:
        """Refuse what is asked by another name, or by a page of another site."""
        if not self.site.access.knows_host(self.request.host):
            self.refuse(403, f'{self.request.host[:80]!r} is not a name of this machine')
        elif not same_origin(self.request.headers.get('Origin'), self.request.host):
            self.refuse(403, 'a page of another site asked for this')

    @property
    def cookie(self) -> str:
        """Name of the cookie: those of all ports of a host are sent together."""
        return f'hunt_ros_{self.site.port}'

    @property
    def right(self) -> str:
        """What this browser may do: '', 'view' or 'command'."""
        if not self.site.access.tokens:
            return COMMAND
        right, typed_s = self._signed_in()
        return right if time.time() < typed_s + self.site.session_s else ''

    @property
    def may_stop(self) -> bool:
        """Whether this browser may stop the rig: also where its session has ended."""
        return self.right == COMMAND or self._signed_in()[0] == COMMAND

    @property
    def ended(self) -> str:
        """One line where there was a session, and it has ended; else ''."""
        if self.right or not self._signed_in()[0]:
            return ''
        hours = f'{self.site.session_s / 3600.0:.3g} h'
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
        """Say in one line what went wrong."""
        self.refuse(status_code, self._reason)


class PageHandler(Handler):
    """One of the two pages, or the form for a token where one is needed."""

    def initialize(self, name: str) -> None:
        """Take the name of the file."""
        self._name = name

    def get(self) -> None:
        """Answer with the page."""
        name = self._name if self.right else 'login.html'
        said = self.ended or (
            'This is none of the tokens' if 'wrong' in self.request.query else ''
        )
        text = self.site.files[name].decode()
        text = text.replace('{{version}}', self.site.version).replace(
            '{{title}}', tornado.escape.xhtml_escape(self.site.title)
        )
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        text = text.replace('{{said}}', tornado.escape.xhtml_escape(said))
        text = text.replace('{{stop}}', '' if self.may_stop else 'hidden')
        self.finish(text.replace('{{right}}', self.right))


class SessionHandler(Handler):
    """What this browser may do now, for a page that has lost its connection."""

    def get(self) -> None:
        """Answer with the right, and whether a session has ended."""
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps({'right': self.right, 'message': self.ended}))


class ListingHandler(Handler):
    """The recordings, as they are now."""

    async def get(self) -> None:
        """Answer with the list."""
        if not self.right:
            self.refuse(401, 'a token is needed')
            return
        # Not in the thread of the live page: a folder on a slow disk may take its time.
        loop = asyncio.get_running_loop()
        listing = await loop.run_in_executor(None, self.site.recordings.listing)
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps(listing, allow_nan=False))


class ComparisonHandler(Handler):
    """The recordings that are chosen, side by side."""

    async def get(self) -> None:
        """Answer with the comparison."""
        if not self.right:
            self.refuse(401, 'a token is needed')
            return
        names = set(self.get_arguments('recording', strip=False))
        dark = self.get_argument('scheme', '') == 'night'
        answer = await asyncio.get_running_loop().run_in_executor(None, self._compare, names, dark)
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps(answer, allow_nan=False))

    def _compare(self, names: set[str], dark: bool) -> dict[str, Any]:
        recordings = self.site.recordings
        listing = recordings.listing()
        rows = [row for row in listing['recordings'] if row['name'] in names]
        found = compare(rows, recordings.directory, dark)
        gone = [row['name'] for row in rows if row['state'] == 'gone']
        gone += sorted(names - {row['name'] for row in rows})
        if gone:
            found['problem'] = f'{", ".join(gone)}: {GONE}'
            found['without'] = [name for name in found['without'] if name not in gone]
        return found


class ReportHandler(Handler):
    """The report of a recording."""

    async def get(self, name: str) -> None:
        """Answer with the report."""
        if not self.right:
            self.refuse(401, 'a token is needed')
            return
        loop = asyncio.get_running_loop()
        path = await loop.run_in_executor(None, self.site.recordings.report, name)
        try:
            if path is None:
                raise FileNotFoundError
            content = await loop.run_in_executor(None, path.read_bytes)
        except OSError:
            self.refuse(404, f'there is no report of {name[:80]}')
            return
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        self.finish(content)


class StaticHandler(Handler):
    """Scripts, styles and figures: nothing secret."""

    def get(self, name: str) -> None:
        """Answer with the file."""
        kind = _KINDS.get(name.rpartition('.')[2], 'application/json')
        self.set_header('Content-Type', f'{kind}; charset=utf-8')
        self.finish(self.site.files[name])


class BokehHandler(Handler):
    """BokehJS as it comes with the wheel."""

    def get(self) -> None:
        """Answer with the script."""
        self.set_header('Content-Type', 'text/javascript; charset=utf-8')
        self.finish((Path(bokehjs_path()) / 'js' / 'bokeh.min.js').read_bytes())


class LoginHandler(Handler):
    """Takes a token, and gives a cookie for it."""

    async def post(self) -> None:
        """Answer with a cookie, or with the form again."""
        right = self.site.access.right_of(self.get_body_argument('token', ''))
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


class CommandHandler(Handler):
    """Does what an operator asks for, and answers when it is done."""

    async def post(self) -> None:
        """Do it, and answer with how it went."""
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
        done, message = await asyncio.wrap_future(self.site.command(word, words))
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps({'done': done, 'message': message}))


class PageSocket(Handler, tornado.websocket.WebSocketHandler):
    """The connection of an open page."""

    def prepare(self) -> None:
        """Refuse who has not signed in."""
        super().prepare()
        if not self._finished and not self.right:
            self.refuse(401, 'a token is needed')

    def check_origin(self, origin: str) -> bool:
        """Return False for a page of another site."""
        return same_origin(origin, self.request.host)

    def introduce(self) -> None:
        """Say which version this is, and what the viewer may do."""
        about = {'version': self.site.version, 'right': self.right}
        self.write_message(json.dumps({'about': about}))
