"""The web server, over HTTP and websockets: rights, origins, stalled viewers."""

from __future__ import annotations

import asyncio
import dataclasses
import gc
import itertools
import json
import socket
import time
import urllib.error
import urllib.parse
import urllib.request
from concurrent.futures import ThreadPoolExecutor, as_completed
from http.cookiejar import CookieJar

import pytest
from told_made import ask
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.web import create_signed_value
from tornado.websocket import websocket_connect

from hunt_ros.dashboard import viewer_socket
from hunt_ros.dashboard.access import Access
from hunt_ros.dashboard.view import Section, View


def first_messages(url: str, count: int = 2, **headers: str) -> list[dict]:
    """Return the first messages of the websocket."""

    async def listen() -> list[dict]:
        address = url.replace('http', 'ws', 1) + 'live'
        link = await websocket_connect(HTTPRequest(address, headers=headers))
        return [json.loads(await link.read_message()) for _ in range(count)]

    return asyncio.run(asyncio.wait_for(listen(), 20))


@pytest.mark.parametrize(
    'name',
    ['', 'page.js', 'figures.js', 'page.css', 'colours.css', 'recordings', 'recordings.js'],
)
def test_everything_the_pages_load_comes_from_this_server(live, name) -> None:
    code, text = ask(live.url + name)
    assert code == 200
    assert len(text) > 100
    assert '://' not in text.replace('http://www.w3.org/2000/svg', '')
    assert name or 'href="recordings"' in text


def test_what_lies_beside_its_files_is_not_served(live) -> None:
    assert ask(live.url + 'uPlot.iife.min.js')[0] == 200
    assert ask(live.url + '../server.py')[0] == 404


def test_a_viewer_is_told_version_right_and_the_whole_then_differences(live) -> None:
    messages = first_messages(live.url, 4)
    about, whole, *rest = messages
    assert about['about']['right'] == 'command'
    assert about['about']['version'] in ask(live.url)[1]
    assert {'status', 'numbers', 'diagram', 'nodes'} <= set(whole['sections'])
    assert all('diagram' not in each['sections'] for each in rest)


def test_a_command_is_done_and_its_answer_returned(live) -> None:
    asked = {'word': 'mark', 'words': 'bump at joint 3'}
    assert ask(live.url + 'command', asked) == (200, '{"done": true, "message": ""}')
    live.reply = (False, 'the node is not active')
    code, text = ask(live.url + 'command', {'word': 'start-profile'})
    assert (code, json.loads(text)) == (200, {'done': False, 'message': 'the node is not active'})
    assert live.calls == [('mark', 'bump at joint 3'), ('start-profile', '')]


def test_commands_and_websockets_of_other_sites_are_refused(live) -> None:
    stop, command = {'word': 'emergency-stop'}, live.url + 'command'
    for origin in ('http://evil.example', 'null', 'http://127.0.0.1:9', 'http://[bad', '://'):
        assert ask(command, stop, Origin=origin)[0] == 403
    assert ask(command, stop, Host='evil.example')[0] == 403
    assert ask(command, stop, Content_Type='text/plain')[0] == 415
    assert ask(command, ['emergency-stop'])[0] == 400
    assert ask(command, {'word': 7})[0] == 400
    deep = urllib.request.Request(command, b'[' * 4000, {'Content-Type': 'application/json'})
    with pytest.raises(urllib.error.HTTPError, match='400'):
        urllib.request.urlopen(deep, timeout=20)
    with pytest.raises(HTTPClientError, match='403'):
        first_messages(live.url, Origin='http://evil.example')
    assert live.calls == []
    here = live.url.rstrip('/')
    assert ask(command, stop, Origin=here)[0] == 200


def log_in(url: str, token: str, **more: str):
    """Return an opener with the cookie that a token gives; its `page` is where that leads."""
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
    form = urllib.parse.urlencode({'token': token, **more}).encode()
    with opener.open(url + 'login', form, timeout=20) as answer:
        assert token not in answer.url, 'an address is logged'
        opener.page = answer.url
    return opener


def test_without_a_token_there_is_only_the_form_for_one(guarded) -> None:
    assert 'type="password"' in ask(guarded.url)[1]
    assert 'type="password"' in ask(guarded.url + 'recordings')[1]
    assert ask(guarded.url + 'recordings.json')[0] == 401
    assert ask(guarded.url + 'report/run')[0] == 401
    assert ask(guarded.url + 'command', {'word': 'rearm'})[0] == 403
    with pytest.raises(HTTPClientError, match='401'):
        first_messages(guarded.url)
    assert 'type="password"' in ask(guarded.url, opener=log_in(guarded.url, 'c' * 16))[1]
    assert 'type="password"' in ask(f'{guarded.url}?token={"b" * 16}')[1], 'none in an address'
    assert guarded.calls == []


def test_one_token_lets_view_and_the_other_command(guarded) -> None:
    viewer, operator = (log_in(guarded.url, letter * 16) for letter in 'ab')
    assert 'content="view"' in ask(guarded.url, opener=viewer)[1]
    assert ask(guarded.url + 'recordings.json', opener=viewer)[0] == 200
    assert ask(guarded.url + 'command', {'word': 'rearm'}, opener=viewer)[0] == 403
    assert guarded.calls == []
    assert ask(guarded.url + 'command', {'word': 'rearm'}, opener=operator)[0] == 200
    assert guarded.calls == [('rearm', '')]


def test_a_session_ends_and_leaves_the_emergency_stop_alone(guarded) -> None:
    viewer, operator = (log_in(guarded.url, letter * 16) for letter in 'ab')
    guarded.server.site.session_s = -1.0
    for opener in (viewer, operator):
        page = ask(guarded.url, opener=opener)[1]
        assert 'type="password"' in page
        assert 'The session has ended' in page
        assert ask(guarded.url + 'recordings.json', opener=opener)[0] == 401
        code, text = ask(guarded.url + 'command', {'word': 'rearm'}, opener=opener)
        assert code == 401
        assert 'sign in again' in json.loads(text)['message']
        told = json.loads(ask(guarded.url + 'session', opener=opener)[1])
        assert (told['right'], 'sign in again' in told['message']) == ('', True)
    assert guarded.calls == []
    stop = {'word': 'emergency-stop'}
    assert ask(guarded.url + 'command', stop, opener=viewer)[0] == 401
    assert ask(guarded.url + 'command', stop, opener=operator)[0] == 200
    assert ask(guarded.url + 'command', stop)[0] == 403, 'never signed in'
    assert guarded.calls == [('emergency-stop', '')]


def test_a_cookie_of_a_right_that_no_token_gives_is_refused(guarded) -> None:
    """Also one that was signed with the right key: the line of its token was taken out."""
    port = guarded.server.site.port
    cookie = f'hunt_ros_{port}=command'  # not signed
    assert ask(guarded.url + 'recordings.json', Cookie=cookie)[0] == 401
    guarded.server.site.access = dataclasses.replace(
        guarded.server.site.access, tokens=guarded.rules.tokens[1:]
    )
    for right, code in (('command', 401), ('view', 200)):
        signed = create_signed_value(
            guarded.rules.secret, f'hunt_ros_{port}', f'{right} {time.time():.0f}'
        ).decode()
        cookie = f'hunt_ros_{port}={signed}'
        assert ask(guarded.url + 'recordings.json', Cookie=cookie)[0] == code
        assert ask(guarded.url + 'command', {'word': 'emergency-stop'}, Cookie=cookie)[0] == 403
    assert guarded.calls == []


def test_a_viewer_that_takes_nothing_is_dropped_and_the_others_do_not_notice(
    guarded, machine, monkeypatch
) -> None:
    monkeypatch.setattr(viewer_socket, '_STALLED_S', 0.3)
    guarded.server.site.access = Access()
    link = socket.socket()
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    link.connect(('127.0.0.1', guarded.server.site.port))
    link.sendall(
        b'GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
        b'Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n'
    )
    numbers = itertools.count(2)

    def dropped() -> int:
        number = next(numbers)
        guarded.server.publish(View({'status': Section(number, f'{number}' * 200_000)}))
        return guarded.server.site.live.dropped

    machine.until(dropped)
    assert not guarded.server.site.live.viewers
    guarded.server.publish(View({'status': Section(0, 'after')}))
    _, whole = first_messages(guarded.url)
    assert 'status' in whole['sections']
    link.close()


@pytest.mark.filterwarnings('error::pytest.PytestUnraisableExceptionWarning')
def test_a_server_that_ends_takes_its_pages_with_it_and_leaves_nothing_behind(live) -> None:
    async def watch() -> None:
        link = await websocket_connect(live.url.replace('http', 'ws', 1) + 'live')
        await link.read_message()
        assert len(live.server.site.live.viewers) == 1
        await asyncio.get_running_loop().run_in_executor(None, live.server.close)

    asyncio.run(asyncio.wait_for(watch(), 60))
    assert not live.server.site.live.viewers
    gc.collect()


def test_what_is_not_there_is_refused_like_all_else_and_head_is_answered(live) -> None:
    request = urllib.request.Request(live.url + 'nothing')
    with pytest.raises(urllib.error.HTTPError) as refusal:
        urllib.request.urlopen(request, timeout=20)
    assert refusal.value.code == 404
    assert refusal.value.headers['Server'] == 'hunt_ros'
    assert 'Content-Security-Policy' in refusal.value.headers
    assert ask(live.url + 'nothing', Host='evil.example')[0] == 403
    assert ask(live.url + 'nothing.css')[0] == 404
    with urllib.request.urlopen(
        urllib.request.Request(live.url, method='HEAD'), timeout=20
    ) as answer:
        assert (answer.status, answer.read()) == (200, b'')
    squeezed = urllib.request.Request(
        live.url + 'uPlot.iife.min.js', headers={'Accept-Encoding': 'gzip'}
    )
    with urllib.request.urlopen(squeezed, timeout=20) as answer:
        assert answer.headers['Content-Encoding'] == 'gzip'


def test_who_asks_for_too_much_at_a_time_is_refused_and_the_stop_never(
    live, guarded, machine
) -> None:
    """Wrong tokens, files of a slow disk, commands without answer: each kind has its bound."""
    live.holds = True
    with ThreadPoolExecutor(20) as many:
        asked = [many.submit(ask, live.url + 'command', {'word': 'mark'}) for _ in range(17)]
        refused = next(as_completed(asked)).result()
        assert refused[0] == 503
        assert 'try again' in refused[1]
        stop = many.submit(ask, live.url + 'command', {'word': 'emergency-stop'})
        machine.until(lambda: ('emergency-stop', '') in live.calls)
        live.holds = False
        for answer in live.held:
            answer.set_result((True, ''))
        assert stop.result()[0] == 200
        codes = sorted(each.result()[0] for each in asked)
        assert codes == [200] * 16 + [503]
        form = urllib.parse.urlencode({'token': 'c' * 16}).encode()

        def guess() -> int:
            try:
                return urllib.request.urlopen(guarded.url + 'login', form, timeout=20).status
            except urllib.error.HTTPError as error:
                return error.code

        assert 503 in [each.result() for each in [many.submit(guess) for _ in range(20)]]


def test_who_signs_in_comes_to_the_page_that_was_asked_for(guarded) -> None:
    assert 'name="back" value="recordings"' in ask(guarded.url + 'recordings')[1]
    for back, page in (('recordings', 'recordings'), ('index', ''), ('//evil.example', '')):
        assert log_in(guarded.url, 'a' * 16, back=back).page == guarded.url + page
