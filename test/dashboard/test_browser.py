"""The page in a real browser: it moves, it alarms, its buttons work, it says when it is stale."""

from __future__ import annotations

import dataclasses
import json
import shutil
import urllib.parse
from pathlib import Path

import pytest

pytest.importorskip('bokeh', reason='the extra dashboard is not installed')
from hunt_ros.dashboard import site
from hunt_ros.dashboard.access import Access
from hunt_ros.detection.acceptance import form_words
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

BAG = Path(__file__).parents[2] / 'bags' / 'kick_escapes'
#: The point of the diagram, in the data of BokehJS.
_POINT = "() => { const s = source('diagram', 'point').data; return [s.v[0], s.a[0]]; }"


@pytest.fixture
def page(new_page, live) -> object:
    opened = new_page()
    opened.goto(live.url)
    opened.wait_for_function("() => figures.waterfall && document.body.dataset.link === 'up'")
    opened.errors.clear()
    return opened


def word(page, text: str) -> None:
    """Wait until the level on the page is this word."""
    wanted = f"document.getElementById('word')?.textContent === {json.dumps(text)}"
    page.wait_for_function(f'() => {wanted}')


def test_the_point_moves_the_alarm_shows_and_nothing_fails(page, live) -> None:
    word(page, 'WARN')
    page.wait_for_function(
        f'() => {{ const p = ({_POINT})(); return p[0] === 7 && p[1] === 0.1; }}'
    )
    live.status |= {
        'speed_mps': '7.5', 'amplitude_m': '6e-04', 'level': 'ERROR', 'state': 'limit_cycle',
        'message': 'limit cycle for 2 s: it grew; low margin', 'alarm': 'True',
    }  # fmt: skip
    word(page, 'ERROR')
    page.wait_for_function(
        f'() => {{ const p = ({_POINT})(); return p[0] === 7.5 && p[1] === 0.6; }}'
    )
    assert 'limit cycle' in page.inner_text('#state')
    assert page.inner_text('#why') == 'limit cycle for 2 s: it grew'
    assert 'alarm not acknowledged' in page.inner_text('#more')
    # The point is drawn with the words, the rest as often as this machine can.
    page.wait_for_function("() => source('diagram', 'stable').data.v.length > 50")
    page.wait_for_function("() => source('lateral', 'signal').data.t.length > 50")
    assert page.errors == []


#: Imitates a browser that is slow to draw, and notes at each new word what the point looks like.
_NOTE_POINTS = """(late_ms) => {
  const native = window.requestAnimationFrame;
  window.requestAnimationFrame = (draw) => setTimeout(() => native(draw), late_ms);
  window.noted = [];
  const note = () => {
    const [dot] = [...tagged('diagram', 'fill:level')];
    const fits = dot.fill_color.value === variable(byId('word').textContent.toLowerCase());
    noted.push([byId('word').textContent, source('diagram', 'point').data.v.length, fits]);
  };
  new MutationObserver(note).observe(byId('word'), {childList: true, subtree: true});
}"""


def test_words_and_point_change_in_one_drawing_however_slow_the_browser_is(page, live) -> None:
    word(page, 'WARN')
    page.evaluate(_NOTE_POINTS, 150)
    for level in ('STALE', 'ERROR', 'OK', 'STALE', 'ERROR'):
        live.status |= {'level': level}
        word(page, level)
    live.restart()
    word(page, 'STALE')
    noted = page.evaluate('noted')
    assert [each[0] for each in noted] == ['STALE', 'ERROR', 'OK', 'STALE', 'ERROR', 'STALE']
    assert all(fits for *_, fits in noted), noted
    assert [points for _, points, _ in noted] == [1, 1, 1, 1, 1, 0], 'none without a server'


def test_a_silent_detector_greys_the_page_and_a_new_word_brings_it_back(page, live) -> None:
    live.speaks = False
    word(page, 'STALE')
    assert page.get_attribute('body', 'data-link') == 'silent'
    assert 'DETECTOR IS SILENT' in page.inner_text('#link')
    veil = "() => getComputedStyle(document.body, '::after').position"
    assert page.evaluate(veil) == 'fixed'
    live.speaks = True
    word(page, 'WARN')
    assert not page.is_visible('#link')


def test_a_page_without_its_server_says_so_and_comes_back_by_itself(page, live) -> None:
    again = live.restart()
    word(page, 'STALE')
    assert page.get_attribute('body', 'data-link') == 'lost'
    assert 'NO CONNECTION' in page.inner_text('#link')
    page.click('#emergency')
    page.wait_for_function("() => byId('answer').className === 'refused'")
    assert 'USE THE HARD-WIRED STOP' in page.inner_text('#answer')
    again()
    word(page, 'WARN')
    assert page.get_attribute('body', 'data-link') == 'up'


def test_the_emergency_stop_is_one_click_or_one_key_at_every_width(page, live) -> None:
    for width, height in ((390, 844), (1280, 800), (1920, 1080)):
        page.set_viewport_size({'width': width, 'height': height})
        box = page.locator('#emergency').bounding_box()
        assert box['x'] >= 0
        assert box['x'] + box['width'] <= width
        assert box['y'] + box['height'] <= height
        assert page.evaluate('() => document.documentElement.scrollWidth <= innerWidth')
    page.click('#emergency')
    page.keyboard.press('Escape')
    page.wait_for_function("() => !byId('answer').hidden")
    page.wait_for_timeout(1)
    while len(live.calls) < 2:
        page.wait_for_timeout(20)
    assert live.calls == [('emergency-stop', '')] * 2


def test_the_name_is_asked_once_and_a_refusal_stays_until_it_is_closed(page, live) -> None:
    page.click('text=acknowledge alarm')
    page.fill('#operator', 'Mia')
    page.keyboard.press('Enter')
    page.wait_for_function("() => byId('answer').className === 'done'")
    live.reply = (False, 'hunting goes on')
    page.click('text=acknowledge alarm')
    page.wait_for_function("() => byId('answer').className === 'refused'")
    assert page.inner_text('#answer span') == 'acknowledge: hunting goes on'
    assert live.calls == [('acknowledge', 'Mia')] * 2
    page.fill('#words', 'bump at joint 3')
    live.reply = (True, 'marked')
    page.keyboard.press('Enter')
    page.wait_for_function("() => byId('answer').className === 'done'")
    assert live.calls[-1] == ('mark', 'bump at joint 3')


def test_a_session_that_ends_shows_one_message_a_form_and_the_emergency_stop(page, live) -> None:
    token = 'b' * 16
    live.server.site.access = Access((('command', token),))
    page.goto(live.url)
    page.fill('[name=token]', token)
    page.keyboard.press('Enter')
    word(page, 'WARN')
    live.server.site.session_s = -1.0
    word(page, 'STALE')
    assert page.inner_text('#why').startswith('The session has ended')
    assert page.is_visible('#again')
    page.click('#emergency')
    page.wait_for_function("() => byId('answer').className === 'done'")
    assert live.calls == [('emergency-stop', '')]
    live.server.site.session_s = 3600.0
    page.fill('#again [name=token]', token)
    page.click('#again button')
    word(page, 'WARN')
    live.server.site.session_s = -1.0
    page.goto(live.url)
    page.click('#emergency')
    page.wait_for_function(
        "() => document.getElementById('stopped').textContent === 'emergency stop: done'"
    )


def test_what_holds_the_drive_stands_with_the_level_and_can_be_rearmed(page, live) -> None:
    live.drive = {
        'target_mps': '5.9', 'profile_state': 'paused', 'interlock': 'protect',
        'interlock_state': 'tripped', 'emergency_stop': 'false',
        'interlock_cause': 'the detector says ERROR: limit cycle; low margin',
    }  # fmt: skip
    page.wait_for_function("() => byId('held').textContent")
    cause = 'the detector says ERROR: limit cycle'
    assert page.inner_text('#held') == f'INTERLOCK TRIPPED, until rearmed: {cause}'
    page.click('#rearm')
    page.wait_for_function("() => byId('answer').className === 'done'")
    assert live.calls == [('rearm', '')]
    live.drive |= {'emergency_stop': 'true'}
    page.wait_for_function("() => byId('held').textContent.startsWith('EMERGENCY STOP')")
    assert page.is_visible('#drive')
    live.drive |= {'emergency_stop': 'false', 'interlock_state': 'armed'}
    page.wait_for_function("() => byId('held').hidden && byId('rearm').hidden")
    live.restart()
    word(page, 'STALE')
    assert not page.is_visible('#drive'), 'nobody knows'


def test_day_and_night_differ_in_figures_and_words(page) -> None:
    colours = set()
    for _ in range(2):
        colours.add(
            page.evaluate(
                '() => getComputedStyle(document.body).color'
                " + plot('diagram').left[0].axis_label_text_color"
            )
        )
        page.click('#scheme')
    assert len(colours) == 2


def replay_of(page, live, name: str) -> None:
    page.goto(f'{live.url}replay?{urllib.parse.urlencode({"recording": name})}')


def test_a_recording_is_replayed_into_the_same_view_and_the_rig_is_not_touched(page, live) -> None:
    shutil.copytree(BAG, live.folder / 'a run')
    page.goto(live.url + 'recordings')
    page.click('td a >> text=replay')
    page.wait_for_url('**/replay?*')
    page.wait_for_function("() => !byId('playing').disabled")
    page.select_option('#rate', '20')
    # The blow of this recording comes at 10 s: quiet before it, hunting after it.
    page.wait_for_function("() => byId('events').textContent.includes('limit cycle')")
    shutil.rmtree(live.folder / 'a run')  # it was read: what becomes of it does not matter
    page.wait_for_function("() => source('diagram', 'stable').data.v.length > 50")
    assert page.inner_text('#now').endswith('WARN quiet'), 'how the rig is, beside the recording'
    page.wait_for_function('() => !sections.replay.playing')  # at its end
    page.fill('#at', '5')
    page.wait_for_function('() => sections.replay.at_s === 5')
    word(page, 'WARN')
    assert page.inner_text('#events ol').count('limit cycle') == 0, 'not yet at this moment'
    page.fill('#at', '25')
    page.wait_for_function('() => sections.replay.at_s === 25')
    word(page, 'ERROR')
    page.wait_for_function(f'() => {{ const p = ({_POINT})(); return p[0] > 7.1 && p[1] > 0.5; }}')
    assert not page.is_visible('#controls')
    page.keyboard.press('Escape')
    page.wait_for_function("() => byId('answer').className === 'done'")
    assert live.calls == [('emergency-stop', '')], 'the stop of the rig, and nothing else'
    assert page.errors == []


def test_the_recordings_that_are_chosen_are_compared_in_two_figures(page, live) -> None:
    for name in ('one', 'two'):
        shutil.copytree(BAG, live.folder / name)
        shutil.copy(BAG.parent / 'paper.yaml', live.folder / f'{name}.yaml')
    page.goto(live.url + 'recordings')
    page.wait_for_function("() => byId('said').textContent.endsWith('2 recordings')")
    assert page.is_disabled('#compare')
    for name in ('one', 'two'):
        page.check(f'[aria-label="compare {name}"]')
    page.click('#compare')
    for name in ('speeds', 'diagram'):
        page.locator(f'#{name} canvas').first.wait_for()
    assert page.locator('#forms tr').count() == 2
    assert page.inner_text('#compared') == ''
    assert page.errors == []


def test_a_recording_that_vanished_is_one_message_and_no_replay(page, live) -> None:
    replay_of(page, live, 'gone')
    page.wait_for_function("() => byId('why').textContent.includes('not in the folder any more')")
    assert page.inner_text('#why').startswith('gone: ')
    assert page.is_disabled('#playing')
    assert not page.is_visible('#link')
    damaged = live.folder / 'cut.mcap'
    damaged.write_bytes(b'no recording')
    replay_of(page, live, 'cut.mcap')
    page.wait_for_function("() => byId('why').textContent.startsWith('cut.mcap: ')")


def test_the_page_of_a_replay_fits_every_width(page, live) -> None:
    shutil.copytree(BAG, live.folder / 'run')
    replay_of(page, live, 'run')
    page.wait_for_function("() => !byId('playing').disabled")
    for width, height in ((390, 844), (1280, 800), (1920, 1080)):
        page.set_viewport_size({'width': width, 'height': height})
        assert page.evaluate('() => document.documentElement.scrollWidth <= innerWidth')
        box = page.locator('#emergency').bounding_box()
        assert box['y'] + box['height'] <= height


def test_a_page_of_yesterday_is_loaded_again_when_its_server_was_renewed(
    page, live, tmp_path, monkeypatch
) -> None:
    before = page.get_attribute('meta[name=hunt-version]', 'content')
    page.evaluate('() => { window.ofYesterday = true; }')
    again = live.restart()
    files = shutil.copytree(str(site._STATIC), tmp_path / 'static')
    with (files / 'page.js').open('a') as script:
        script.write('window.ofToday = (window.ofToday ?? 0) + 1;\n')
    monkeypatch.setattr(site, '_STATIC', files)
    again()
    page.wait_for_function("() => window.ofToday && document.body.dataset.link === 'up'")
    word(page, 'WARN')
    assert page.evaluate('() => [window.ofYesterday, window.ofToday]') == [None, 1]
    assert page.get_attribute('meta[name=hunt-version]', 'content') != before


def test_two_operators_who_press_at_once_each_get_their_answer(
    page, new_page, live, machine
) -> None:
    other = new_page()
    other.goto(live.url)
    word(other, 'WARN')
    for each, name in ((page, 'Mia'), (other, 'Tom')):
        each.evaluate('name => localStorage.setItem("hunt-operator", name)', name)
    live.holds = True
    page.click('text=acknowledge alarm')
    other.click('text=acknowledge alarm')
    deadline = machine.deadline(20.0)
    while len(live.held) < 2:
        assert not deadline.passed, live.calls
        page.wait_for_timeout(20)
    assert sorted(live.calls) == [('acknowledge', 'Mia'), ('acknowledge', 'Tom')]
    # The second is answered first, and refused.
    live.held[1].set_result((False, 'acknowledged already'))
    live.held[0].set_result((True, ''))
    answers = {}
    for (_, name), done in zip(live.calls, (True, False), strict=True):
        answers[name] = 'acknowledge: done' if done else 'acknowledge: acknowledged already'
    for each, name in ((page, 'Mia'), (other, 'Tom')):
        each.wait_for_function("() => byId('answer').className")
        assert each.inner_text('#answer span') == answers[name]


def test_a_form_that_is_replaced_is_drawn_as_soon_as_it_is_known(page, live) -> None:
    v_c = "source('diagram', 'speeds').data.v[1]"
    page.wait_for_function(f'() => {v_c} === 8')
    form = dataclasses.replace(PAPER_NORMAL_FORM, critical_speed=7.5)
    other = IdentifiedNormalForm(form)
    live.status |= {'normal_form': form_words(other)}
    page.wait_for_function("() => byId('form').textContent.includes('not known here')")
    page.wait_for_function("() => source('diagram', 'stable').data.v.length === 0")
    word(page, 'WARN')
    assert live.model.take_form(other.to_yaml()) == ''
    page.wait_for_function(f'() => {v_c} === 7.5')
    assert '7.5' in page.inner_text('#form')
    assert page.errors == []
