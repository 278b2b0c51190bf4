"""The connection of a page that shows a recording, and the process that plays it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import sys
import time
from collections.abc import Mapping

import tornado.websocket

from hunt_ros.dashboard.handlers import PageSocket
from hunt_ros.dashboard.recordings import GONE

#: Each is a process with the numerics of a detector.
_MOST_REPLAYS = 4
#: The viewer of a replay hears so often how the rig is now, and that the server is there, s.
_HEARTBEAT_S = 0.25
#: The first picture of a replay is its longest line, bytes.
_LONGEST_LINE = 2**24


class ReplaySocket(PageSocket):
    """
    A page that shows a recording: what a process of its own plays (`player`), and the rig now.

    The process ends with the connection. A page that takes its updates slowly slows its own
    replay down, and nothing else.
    """

    def open(self, *arguments: str, **keywords: str) -> None:
        """Say who this is, and begin to play."""
        self._child: asyncio.subprocess.Process | None = None
        self._closed = False
        self.introduce()
        self.task = asyncio.ensure_future(self._play(self.get_argument('recording', '')))

    def on_message(self, message: str | bytes) -> None:
        """Hand an order of the viewer on."""
        order = _order(message)
        if order and self._child is not None and self._child.stdin is not None:
            self._child.stdin.write(json.dumps(order).encode() + b'\n')

    def on_close(self) -> None:
        """End the process."""
        self._closed = True
        if self._child is not None:
            with contextlib.suppress(ProcessLookupError):
                self._child.kill()

    async def _play(self, name: str) -> None:
        """Send what the process prints, until it ends or nobody looks any more."""
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(None, self.site.recordings.to_play, name)
        if found is None:
            await self._fail(name, GONE)
        elif len(self.site.replays) >= _MOST_REPLAYS:
            await self._fail(name, f'{_MOST_REPLAYS} replays run already: close one of them')
        elif not self._closed:
            self.site.replays.add(self)
            try:
                said = await self._run(found)
            finally:
                self.site.replays.discard(self)
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
        now = self.site.live.view.sections.get('status')
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
