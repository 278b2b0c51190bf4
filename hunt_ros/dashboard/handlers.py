"""What the server answers, request by request: rights, pages, files and commands."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import time
import urllib.parse
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeVar

import tornado.escape
import tornado.iostream
import tornado.web

from hunt_ros.dashboard.access import COMMAND, same_origin
from hunt_ros.dashboard.site import Site

_Result = TypeVar('_Result')
#: A file is sent in pieces of this size.
_PIECE_BYTES = 1 << 18
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
        return (right, float(typed_s)) if self.site.access.gives(right) and typed_s else ('', 0.0)

    def head(self, *arguments: str) -> Awaitable[None] | None:
        """Answer as to GET, of which tornado sends the headers alone."""
        return self.get(*arguments)

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
        """Take the name of the page."""
        self._name = name

    def get(self) -> None:
        """Answer with the page."""
        said = self.ended or (
            'This is none of the tokens' if 'wrong' in self.request.query else ''
        )
        text = self.site.files[f'{self._name}.html' if self.right else 'login.html'].decode()
        for name, words in (
            ('version', self.site.version),
            ('title', self.site.title),
            ('said', said),
            ('back', self._name),
            ('right', self.right),
            ('stop', '' if self.may_stop else 'hidden'),
        ):
            text = text.replace(f'{{{{{name}}}}}', tornado.escape.xhtml_escape(words))
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        self.finish(text)


class NothingHandler(Handler):
    """Answers what is asked for and not there, with the headers of all else."""

    def prepare(self) -> None:
        """Refuse it."""
        super().prepare()
        if not self._finished:
            self.refuse(404, 'there is nothing of this name')


class SessionHandler(Handler):
    """What this browser may do now, for a page that has lost its connection."""

    def get(self) -> None:
        """Answer with the right, and whether a session has ended."""
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps({'right': self.right, 'message': self.ended}))


class FolderHandler(Handler):
    """
    The recordings: their list, and one by one their files, forms and reports.

    The disk is read beside the thread of the live page, which a slow one must not hold, and by
    few at a time.
    """

    def prepare(self) -> None:
        """Refuse who has not signed in."""
        super().prepare()
        if not self._finished and not self.right:
            self.refuse(401, 'a token is needed')

    async def get(self, name: str = '', file: str = '') -> None:
        """Answer with what is asked for."""
        recordings, what = self.site.recordings, self.request.path.split('/')[1]
        async with self.site.reading:
            if what == 'recordings.json':
                said = await _beside(recordings.listing)
                for form in filter(None, (row['form'] for row in said['recordings'])):
                    form['words'] = self.site.words.in_unit(form['words'])
                self.set_header('Content-Type', 'application/json')
                self.finish(json.dumps(said, allow_nan=False))
                return
            try:
                if what == 'file':
                    path = await _beside(recordings.file, name, file)
                else:
                    path = await _beside(getattr(recordings, what), name)
                if path is None:
                    raise FileNotFoundError
                if what != 'report':
                    await self._send(path)
                    return
                page = await _beside(path.read_bytes)
            except OSError:
                self.refuse(404, f'there is no {what} of {name[:80]}')
                return
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        self.finish(page)

    async def _send(self, path: Path) -> None:
        """Send a file piece by piece, at the pace of who takes it."""
        self.set_header('Content-Type', 'application/octet-stream')
        name = urllib.parse.quote(f'{path.parent.name}_{path.name}')
        self.set_header('Content-Disposition', f"attachment; filename*=UTF-8''{name}")
        with path.open('rb') as content:
            self.set_header('Content-Length', str(os.fstat(content.fileno()).st_size))
            with contextlib.suppress(tornado.iostream.StreamClosedError):
                while piece := await _beside(content.read, _PIECE_BYTES):
                    self.write(piece)
                    await self.flush()


async def _beside(work: Callable[..., _Result], *arguments: Any) -> _Result:
    """Have work done in a thread of its own."""
    return await asyncio.get_running_loop().run_in_executor(None, work, *arguments)


class StaticHandler(Handler):
    """Scripts and styles: nothing secret."""

    def get(self, name: str) -> None:
        """Answer with the file."""
        if name not in self.site.files:
            self.refuse(404, f'there is no {name[:80]}')
            return
        self.set_header('Content-Type', f'{_KINDS[name.rpartition(".")[2]]}; charset=utf-8')
        self.finish(self.site.files[name])


class LoginHandler(Handler):
    """Takes a token, and gives a cookie for it."""

    async def post(self) -> None:
        """Answer with a cookie, or with the form again."""
        page = '/recordings' if self.get_body_argument('back', '') == 'recordings' else '/'
        async with self.site.signing:
            right = self.site.access.right_of(self.get_body_argument('token', ''))
            if not right:
                await asyncio.sleep(_WRONG_TOKEN_S)
                self.redirect(f'{page}?wrong', status=303)
                return
        self.set_signed_cookie(
            self.cookie,
            f'{right} {time.time():.0f}',
            expires_days=_COOKIE_DAYS,
            httponly=True,
            samesite='Strict',
        )
        self.redirect(page, status=303)


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
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
            self.refuse(400, 'expected {"word": ..., "words": ...}')
            return
        if not (isinstance(word, str) and isinstance(words, str)):
            self.refuse(400, 'expected texts')
            return
        if self.right != COMMAND and not (word == 'emergency-stop' and self.may_stop):
            told = 'this browser may view only: commands need the other token'
            self.refuse(401 if self.ended else 403, self.ended or told)
            return
        # The emergency stop waits for nothing.
        async with contextlib.nullcontext() if word == 'emergency-stop' else self.site.asking:
            done, message, *_ = await asyncio.wrap_future(self.site.command(word, words))
        self.set_header('Content-Type', 'application/json')
        self.finish(json.dumps({'done': done, 'message': self.site.words.in_unit(message)}))
