"""The page in a real browser: it moves, it alarms, its buttons work, it says when it is stale."""

from __future__ import annotations

import dataclasses
import json
import shutil
import time

import pytest
from told_made import DRIVE, REPLAY

from hunt_ros.dashboard import site
from hunt_ros.dashboard.access import Access
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

#: The point of the diagram: speed and amplitude.
_POINT = '() => shown.point || []'
SIZES = ((390, 844), (820, 1180), (844, 390), (1366, 650), (1920, 1080), (3840, 2160))
_LONG = (
    'limit cycle for 12.3 s, at first: full hunting of 0.709 mm at 7.24 m/s, it grew 16.2 times as'
    ' likely as not'
)


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


def link(page, state: str) -> None:
    """Wait until the page takes its connection for this: it looks at times of its own."""
    page.wait_for_function(f"() => document.body.dataset.link === '{state}'")


#: Whether more than the empty ground is painted in a figure.
_PAINTED = """(name) => {
  const canvas = document.querySelector(`#${name} canvas`);
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  return new Set(new Uint32Array(data.buffer)).size > 3;
}"""


def test_the_point_moves_the_alarm_shows_and_nothing_fails(page, live) -> None:
    word(page, 'WARN')
    page.wait_for_function(
        f'() => {{ const p = ({_POINT})(); return p[0] === 7 && p[1] === 0.1; }}'
    )
    live.status |= {
        'speed_mps': '7.5', 'amplitude_m': '6e-04', 'level': 'ERROR', 'state': 'limit_cycle',
        'message': 'limit cycle for 2 s, at first: it grew; low margin', 'alarm': 'True',
    }  # fmt: skip
    word(page, 'ERROR')
    page.wait_for_function(
        f'() => {{ const p = ({_POINT})(); return p[0] === 7.5 && p[1] === 0.6; }}'
    )
    assert 'limit cycle' in page.inner_text('#state')
    assert page.inner_text('#why') == 'limit cycle for 2 s, at first: it grew'
    assert 'ALARM NOT ACKNOWLEDGED' in page.inner_text('#more')
    # The point is drawn with the words, the rest as often as this machine can.
    page.wait_for_function('() => shown.stable > 50')
    page.wait_for_function('() => shown.lateral > 50')
    # Something of each colour stands in the picture.
    for name in ('diagram', 'lateral', 'yaw', 'spectrum', 'waterfall'):
        page.wait_for_function(_PAINTED, arg=name)
    assert page.errors == []


#: Imitates a browser that is slow to draw, and notes at each new word what the point looks like.
_NOTE_POINTS = """(late_ms) => {
  const native = window.requestAnimationFrame;
  window.requestAnimationFrame = (draw) => setTimeout(() => native(draw), late_ms);
  window.noted = [];
  const note = () => {
    const fits = shown.colour === palette[byId('word').textContent.toLowerCase()];
    noted.push([byId('word').textContent, shown.point ? 1 : 0, fits]);
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


def test_a_silent_rig_greys_the_page_is_not_told_as_if_it_spoke_and_comes_back(page, live) -> None:
    live.drive = dict(DRIVE)
    page.wait_for_function("() => byId('drive').textContent.includes('interlock protect: armed')")
    live.speaks = False
    word(page, 'STALE')
    link(page, 'silent')
    assert 'DETECTOR IS SILENT' in page.inner_text('#link')
    veil = "() => getComputedStyle(document.body, '::after').position"
    assert page.evaluate(veil) == 'fixed'
    page.wait_for_function("() => document.body.dataset.held === 'silent'")
    page.wait_for_function("() => byId('drive').textContent.includes('are not known')")
    assert 'armed' not in page.inner_text('#drive')
    for name in ('start-profile', 'resume-profile'):
        page.wait_for_selector(f'button[data-word="{name}"]:disabled', state='attached')
    assert page.is_enabled('button[data-word="stop-profile"]')
    live.speaks = True
    word(page, 'WARN')
    assert not page.is_visible('#link')


def test_a_page_without_its_server_shows_nothing_of_the_past_and_comes_back_by_itself(
    page, live
) -> None:
    live.status |= {'alarm': 'True'}
    live.drive = DRIVE | {'interlock_state': 'tripped', 'interlock_cause': 'hunting'}
    page.wait_for_selector('button.lit[data-word="acknowledge"]')
    page.wait_for_function("() => !byId('rearm').hidden")
    again = live.restart()
    word(page, 'STALE')
    link(page, 'lost')
    assert 'NO CONNECTION' in page.inner_text('#link')
    assert not page.query_selector_all('button.lit')
    for place in ('#drive', '#rearm', '#held'):
        assert not page.is_visible(place), 'nobody knows'
    assert 'ALARM' not in page.inner_text('#reason')
    page.click('#emergency')
    page.wait_for_function("() => byId('answer').className === 'refused'")
    assert 'USE THE HARD-WIRED STOP' in page.inner_text('#answer')
    live.drive = {}
    again()
    word(page, 'WARN')
    link(page, 'up')


def test_the_emergency_stop_is_one_click_or_one_key_at_every_width(page, live, machine) -> None:
    for width, height in SIZES:
        page.set_viewport_size({'width': width, 'height': height})
        box = page.locator('#emergency').bounding_box()
        assert box['x'] >= 0
        assert box['x'] + box['width'] <= width
        assert box['y'] + box['height'] <= height
        assert page.evaluate('() => document.documentElement.scrollWidth <= innerWidth')
    page.click('#emergency')
    page.keyboard.press('Escape')
    page.wait_for_function("() => !byId('answer').hidden")
    machine.until(lambda: live.calls == [('emergency-stop', '')] * 2, told=lambda: live.calls)


#: Whether all of the text of an element can be seen.
_WHOLE = """(id) => {
  const {scrollWidth, clientWidth, scrollHeight, clientHeight} = byId(id);
  return scrollWidth <= clientWidth && scrollHeight <= clientHeight && clientWidth > 300;
}"""


def test_the_cause_is_read_whole_at_every_width(page, live) -> None:
    live.status |= {'level': 'ERROR', 'state': 'limit_cycle', 'message': f'{_LONG}; low margin'}
    word(page, 'ERROR')
    for width, height in SIZES:
        page.set_viewport_size({'width': width, 'height': height})
        assert page.inner_text('#why') == _LONG
        assert page.evaluate(_WHOLE, 'why'), width


def test_the_diagram_is_whole_on_a_laptop_also_while_the_drive_is_held(page, live) -> None:
    page.set_viewport_size({'width': 1366, 'height': 650})
    live.drive = DRIVE | {'interlock_state': 'tripped', 'interlock_cause': 'hunting'}
    page.wait_for_function("() => !byId('held').hidden")
    box = page.locator('#diagram').bounding_box()
    assert box['y'] + box['height'] <= 650
    assert box['height'] > 300
    # A figure follows its place, and no place its figure.
    page.set_viewport_size({'width': 1366, 'height': 900})
    page.set_viewport_size({'width': 1366, 'height': 650})
    page.wait_for_function(f'() => Math.abs(figures.diagram.height - {box["height"]}) < 2')
    # Above the plot: there no branch is, whatever the form.
    assert page.evaluate('() => figures.diagram.bbox.top > 1.2 * rem * devicePixelRatio')
    # Another screen has other letters: the figures are made anew, with all that was in them.
    for width, height in (*SIZES[::-1], SIZES[0]):
        page.set_viewport_size({'width': width, 'height': height})
        page.wait_for_function(
            """() => parseFloat(getComputedStyle(document.documentElement).fontSize) === rem
              && figures.diagram.data[1][0].length > 50 && figures.diagram.scales.x.max < 10"""
        )


#: How far the trail lies from where its axes put it, pixels: left, right, top, bottom.
_TRAIL_OFF = """() => {
  const plot = figures.diagram;
  const canvas = plot.over.querySelector('canvas');
  const {width, height} = canvas;
  const {data} = canvas.getContext('2d').getImageData(0, 0, width, height);
  const seen = [[], []];
  for (let cell = 0; cell < width * height; cell += 1) if (data[4 * cell + 3] > 100) {
    seen[0].push((cell % width) + 0.5);
    seen[1].push(Math.floor(cell / width) + 0.5);
  }
  const rows = streams.trail.rows.filter(([speed]) => speed !== null);
  const end = (values, most) => values.reduce((a, b) => most(a, b));
  return ['x', 'y'].flatMap((scale, axis) => {
    const wanted = rows.map((row) => plot.valToPos(row[axis], scale));
    const pixel = plot.over.clientWidth / width;
    return [Math.min, Math.max].map(
      (most) => Math.abs(pixel * end(seen[axis], most) - end(wanted, most)));
  });
}"""


def test_the_trail_stays_on_the_branches_when_the_place_changes_and_nothing_is_told(
    page, live
) -> None:
    for speed, amplitude in (('6.5', '1e-04'), ('7.5', '6e-04')):
        live.status |= {'speed_mps': speed, 'amplitude_m': amplitude}
        page.wait_for_function(
            f'() => (streams.trail?.rows ?? []).some(([v]) => v === {float(speed)})'
        )
    live.speaks = False
    link(page, 'silent')
    page.wait_for_function('() => !shown.point')
    for width, height in ((1366, 700), (1366, 900), (1200, 650)):
        page.set_viewport_size({'width': width, 'height': height})
        page.wait_for_function(
            """() => Math.abs(figures.diagram.height - byId('diagram').clientHeight) < 1
              && Math.abs(figures.diagram.width - byId('diagram').clientWidth) < 1"""
        )
        page.evaluate('() => new Promise((after) => requestAnimationFrame(after))')
        off = page.evaluate(_TRAIL_OFF)
        assert max(off) < 2.0, (width, height, off)


def test_the_name_is_asked_once_and_a_refusal_stays_until_it_is_closed(page, live) -> None:
    live.status |= {'alarm': 'True'}
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


def test_what_holds_the_drive_is_no_large_ok_and_rearm_is_held_down_far_from_the_stop(
    page, live
) -> None:
    live.status |= {'level': 'OK'}
    live.drive = DRIVE | {
        'interlock_state': 'tripped', 'level': 'ERROR', 'profile_state': 'paused',
        'interlock_cause': 'the detector says ERROR: limit cycle; low margin',
    }  # fmt: skip
    word(page, 'TRIPPED')
    assert page.inner_text('#chip') == '✓ OK'
    cause = 'the detector says ERROR: limit cycle'
    assert page.inner_text('#holds') == f'INTERLOCK TRIPPED, until rearmed: {cause}'
    assert 'tripped' not in page.inner_text('#drive').lower(), 'once is enough'
    for width, height in SIZES:
        page.set_viewport_size({'width': width, 'height': height})
        rearm, stop = (page.locator(f'#{id}').bounding_box() for id in ('rearm', 'emergency'))
        aside = max(
            stop['x'] - rearm['x'] - rearm['width'], stop['y'] - rearm['y'] - rearm['height']
        )
        assert aside > 100, width
    page.click('#rearm')
    page.wait_for_function("() => byId('answer').className === 'hint'")
    assert live.calls == [], 'pressed, and not held'
    page.hover('#rearm')
    page.mouse.down()  # as long as it takes: a busy browser hears of both ends late
    page.wait_for_function("() => byId('answer').className === 'done'")
    page.mouse.up()
    assert live.calls == [('rearm', '')]
    live.drive |= {'emergency_stop': 'true'}
    word(page, 'STOPPED')
    live.status |= {'level': 'ERROR'}
    word(page, 'ERROR')
    live.status |= {'level': 'OK'}
    live.drive |= {'emergency_stop': 'false', 'interlock_state': 'armed', 'level': 'OK'}
    word(page, 'OK')
    assert not page.is_visible('#held')


@pytest.mark.parametrize(
    ('told', 'words', 'rearm'),
    [
        ({'level': 'ERROR', 'message': 'drive: no answer of it'}, 'drive: no answer', False),
        (
            {
                'emergency_stop': 'true', 'level': 'ERROR',
                'message': 'emergency stop is in force until rearmed (hunt call rearm);'
                ' no answer of the drive',
            },
            'EMERGENCY STOP IS IN FORCE, until rearmed; no answer of the drive', True,
        ),
        ({'alarm_kept': 'limit cycle at 7.2 m/s'}, 'ALARM NOT ACKNOWLEDGED', True),
        ({'interlock_state': 'of a later version'}, '', False),
    ],
)  # fmt: skip
def test_a_rig_without_a_guard_and_an_alarm_of_before_stand_in_the_band(
    page, live, told, words, rearm
) -> None:
    live.drive = DRIVE | told
    page.wait_for_function(
        "(words) => sections.drive && byId('holds').textContent.startsWith(words)", arg=words
    )
    assert page.is_visible('#held') is bool(words)
    assert page.is_visible('#rearm') is rearm
    assert page.errors == []


@pytest.mark.parametrize(
    ('drive', 'lit', 'off'),
    [
        ({}, {'start-profile'}, {'stop-profile', 'resume-profile', 'arm-interlock'}),
        (
            {'profile_state': 'running'}, {'stop-profile'},
            {'start-profile', 'resume-profile', 'arm-interlock'},
        ),
        (
            {'profile_state': 'paused'}, {'resume-profile'}, {'stop-profile', 'arm-interlock'},
        ),
        (
            {'profile_state': 'paused', 'emergency_stop': 'true'}, set(),
            {'start-profile', 'stop-profile', 'resume-profile', 'arm-interlock'},
        ),
        (
            {'interlock_state': 'disarmed'}, {'start-profile', 'arm-interlock'},
            {'stop-profile', 'resume-profile', 'disarm-interlock'},
        ),
        # It waits for the detector: who does not want it to begin can say so.
        (
            {'level': 'WARN', 'message': 'the profile waits'}, {'start-profile'},
            {'resume-profile', 'arm-interlock'},
        ),
    ],
)  # fmt: skip
def test_the_button_that_applies_is_lit_and_what_would_be_refused_is_off(
    page, live, drive, lit, off
) -> None:
    live.drive = DRIVE | drive
    page.wait_for_function(
        '([key, value]) => sections.drive && String(sections.drive[key]) === value',
        arg=list({'profile': 'sweep', **drive}.items())[-1],
    )
    page.wait_for_function("() => byId('drive').textContent.includes('sweep')")
    found = page.evaluate(
        """() => [...document.querySelectorAll('#controls button[data-word]')].map((button) =>
          [button.dataset.word, button.classList.contains('lit'), button.disabled])"""
    )
    assert {name for name, is_lit, _ in found if is_lit} == lit
    assert {name for name, _, is_off in found if is_off} == {'acknowledge', *off}


def test_day_and_night_differ_in_figures_and_words(page) -> None:
    colours = set()
    for _ in range(2):
        colours.add(page.evaluate('() => getComputedStyle(document.body).color + palette.ink'))
        page.click('#scheme')
    assert len(colours) == 2


def test_a_replay_is_not_taken_for_the_rig(page, live) -> None:
    """At no width and in no state: neither its word nor its colour is that of a level."""
    live.status |= {'level': 'ERROR', 'state': 'limit_cycle', 'alarm': 'True'}
    word(page, 'ERROR')
    red = page.evaluate("() => getComputedStyle(document.querySelector('header')).backgroundColor")
    live.model.take_health(REPLAY, time.monotonic())
    word(page, 'REPLAY')
    violet = page.evaluate(
        "() => getComputedStyle(document.querySelector('header')).backgroundColor"
    )
    assert violet != red
    assert page.inner_text('#chip') == '■ ERROR'
    assert 'day_3, 00:12 of 04:14' in page.inner_text('#replay')
    assert not page.is_visible('#controls'), 'nothing of a rig can be commanded'
    assert page.title().startswith('REPLAY')
    assert not page.evaluate("() => getComputedStyle(byId('shape')).animationName !== 'none'")
    page.click('[data-word=pause-replay]')
    page.wait_for_function("() => byId('answer').className === 'done'")
    assert live.calls == [('pause-replay', '')]
    live.drive = DRIVE
    page.wait_for_function('() => sections.drive')
    page.wait_for_selector('#emergency')  # a drive listens
    for width, height in SIZES:
        page.set_viewport_size({'width': width, 'height': height})
        assert page.evaluate('() => document.documentElement.scrollWidth <= innerWidth')
    assert page.errors == []


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
    live.status |= {'alarm': 'True'}
    live.holds = True
    page.click('text=acknowledge alarm')
    other.click('text=acknowledge alarm')
    machine.until(lambda: len(live.held) == 2, told=lambda: live.calls)
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


def test_no_stop_waits_behind_a_recording_that_takes_long_to_close(page, live, machine) -> None:
    live.holds = True
    # More than a browser has connections to one server.
    page.evaluate("() => { for (let k = 0; k < 8; k++) command('stop-recording'); }")
    page.click('#emergency')
    machine.until(lambda: ('emergency-stop', '') in live.calls, told=lambda: live.calls)
    assert live.calls.count(('stop-recording', '')) == 1
    for held in live.held:
        held.set_result((True, ''))
    page.wait_for_function('() => !underWay.size')


def test_a_form_that_is_replaced_is_drawn_as_soon_as_it_is_known(page, live) -> None:
    v_c = 'shown.marks?.[1]?.[1]'
    page.wait_for_function(f'() => {v_c} === 8')
    form = dataclasses.replace(PAPER_NORMAL_FORM, critical_speed=7.5)
    other = IdentifiedNormalForm(form)
    live.status |= {'normal_form': other.words}
    page.wait_for_function("() => byId('form').textContent.includes('not known here')")
    page.wait_for_function('() => shown.stable === 0')
    word(page, 'WARN')
    assert live.model.take_form(other.to_yaml()) == ''
    page.wait_for_function(f'() => {v_c} === 7.5')
    assert '7.5' in page.inner_text('#form')
    assert page.errors == []
