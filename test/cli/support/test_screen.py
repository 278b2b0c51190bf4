"""What the terminal shows of a rig, drawn without a terminal."""

from __future__ import annotations

import pytest
import told_made
from rich.cells import cell_len
from rich.console import Console
from rich.screen import Screen as WholeTerminal

from hunt_ros.cli.support.screen import Screen
from hunt_ros.dashboard.told import Told

STATUS = told_made.STATUS | {
    'amplitude_m': '2e-4',
    'amplitude_std_m': '1e-5',
    'growth_rate_per_s': '-0.21',
    'growth_rate_std_per_s': '0.05',
    'since_s': '95.0',
}
DRIVE = told_made.DRIVE | {
    'profile_state': 'running',
    'profile_elapsed_s': '30.0',
    'profile_remaining_s': '90.0',
    'interlock': 'measure',
}
KEYS = ('s: start-profile', 'space: stop-profile', 'e: emergency-stop', 'q: quit')
LOG = [(f'event number {number} happened', '') for number in range(40)]
SIZES = [(60, 24), (80, 24), (100, 40), (200, 60), (60, 8), (30, 10), (12, 3)]


def screen(now_s: float = 10.1, drive: dict | None = None, **status: str) -> Screen:
    """Return the screen of a rig that said all this at 10 s."""
    told = Told()
    told.take_status(100 * 10**9, STATUS | status, 10.0)
    if drive is not None:
        told.take_speed_status(DRIVE | drive, 10.0)
    told.take_health({'name': 'rig/yaw_sensor', 'level': 'OK'}, 10.0)
    return Screen(told.sections(now_s), LOG, KEYS)


def drawn(
    what: Screen, width: int = 80, height: int = 24, colour: str | None = None, **more
) -> str:
    """Return what a terminal of this size shows."""
    console = Console(width=width, height=height, force_terminal=True, color_system=colour, **more)
    with console.capture() as capture:
        console.print(WholeTerminal(what))
    return capture.get().replace('\r', '')


def bar(text: str, under: str) -> str:
    """Return the bar below the row that begins with this word."""
    rows = text.splitlines()
    (row,) = (k for k, each in enumerate(rows) if each.startswith(f' {under} '))
    return next(each for each in rows[row:] if '─' in each or '█' in each)


@pytest.mark.parametrize(('width', 'height'), SIZES)
@pytest.mark.parametrize('silent', [False, True])
def test_it_fits_every_terminal_and_the_level_is_always_there(width, height, silent) -> None:
    shown = screen(14.0 if silent else 10.1, drive={'profile': 'x' * 300}, message='y ' * 400)
    text = drawn(shown, width, height)
    assert all(cell_len(row) <= width for row in text.split('\n'))
    assert text.count('\n') < height
    assert ('STALE' if silent else 'WARN') in text.split('\n')[0]


def test_sixty_columns_hold_all_that_counts() -> None:
    text = ' '.join(drawn(screen(drive={}), 60, 24).split())
    for words in (
        'WARN for 5 s quiet, hysteresis region', 'a disturbance can start hunting',
        'low margin: 2.1', '7.20 m/s', 'set point ◇ 7.25', 'v_n ┃ 6.40', 'v_c ┃ 8.00',
        '0.200 mm ± 0.010', 'below the unstable branch', 'A_u ┃ 0.420', 'limit cycle ║ 2.100',
        'profile sweep: running', '25 %, 1:30 min left', 'interlock armed, mode measure',
        'event number 39', *KEYS,
    ):  # fmt: skip
        assert words in text, words


def test_the_bars_show_where_the_rig_is_between_its_marks() -> None:
    text = drawn(screen(), 100, 30)
    speed, size = bar(text, 'v'), bar(text, 'A')
    n, c = (at for at, sign in enumerate(speed) if sign == '┃')
    assert n < speed.rindex('█') < c
    assert (speed.rindex('█') - n) / (c - n) == pytest.approx((7.2 - 6.4) / (8.0 - 6.4), abs=0.1)
    assert size.rindex('█') < size.index('┃') < size.index('║')
    text = drawn(screen(amplitude_m='9e-4'), 100, 30)
    assert 'BEYOND the unstable branch' in text
    assert bar(text, 'A').index('┃') < bar(text, 'A').rindex('█')


def test_a_rig_that_stands_still_fills_no_bar() -> None:
    none = dict.fromkeys(('v_n_mps', 'v_c_mps', 'unstable_amplitude_m', 'stable_amplitude_m'), '')
    text = drawn(screen(normal_form='', speed_mps='1e-10', amplitude_m='2e-6', **none))
    assert '█' not in bar(text, 'v')
    assert bar(text, 'A').count('█') < 4
    assert 'e-' not in text


@pytest.mark.parametrize(('level', 'sign'), [('OK', '✓'), ('WARN', '▲'), ('ERROR', '■')])
def test_without_colour_the_level_is_a_word_and_a_sign(level, sign, monkeypatch) -> None:
    monkeypatch.setenv('NO_COLOR', '1')
    plain = drawn(screen(level=level), colour='truecolor')
    assert f'{sign} {level}' in plain
    assert not any(f'\x1b[{code}' in plain for code in ('3', '4', '1;3', '38', '48', '1;7;3'))
    monkeypatch.delenv('NO_COLOR')
    assert '\x1b[1;7;3' in drawn(screen(level=level), colour='truecolor')


def test_a_silent_detector_is_loud_and_none_of_its_numbers_is_shown_as_true() -> None:
    text = drawn(screen(13.0, drive={}, level='OK'), 60)
    first, *rest = text.splitlines()
    assert '? STALE' in first
    assert 'NO WORD FROM THE DETECTOR' in first
    assert 'silent for 3 s: nothing here is up to date' in rest[0]
    assert 'last word: OK, quiet' in text
    assert 'THE SPEED NODE IS SILENT' in text
    for words in ('✓', '7.20', '0.200', 'v_n', 'A_u', '█', 'armed', '25 %'):
        assert words not in text, words
    before = drawn(Screen(Told().sections(5.0)))
    assert 'STALE' in before
    assert 'Ctrl-C: quit' in before


def test_stale_inputs_of_a_detector_that_speaks_say_why() -> None:
    text = drawn(screen(level='STALE', message='lateral: silent for 0.4 s', amplitude_m='nan'))
    assert '? STALE' in text.splitlines()[0]
    assert 'lateral: silent for 0.4 s' in text
    assert 'A  – mm' in text


def test_a_form_that_is_absent_or_replaced_is_shown_as_it_is() -> None:
    none = dict.fromkeys(
        ('v_n_mps', 'v_c_mps', 'unstable_amplitude_m', 'stable_amplitude_m'), 'nan'
    )
    text = drawn(screen(normal_form='', region='unknown', **none))
    assert 'region unknown' in text
    assert 'no normal form: v_n and v_c are not known' in text
    assert '┃' not in text
    other = drawn(screen(normal_form='v_c 7.900 m/s', v_n_mps='nan', v_c_mps='7.9'))
    assert 'v_c ┃ 7.90' in other
    assert 'v_n − v –' in other


def test_alarm_emergency_stop_trip_and_ill_nodes_stand_above_the_numbers() -> None:
    told = Told()
    told.take_status(100 * 10**9, STATUS | {'level': 'ERROR', 'alarm': 'True'}, 10.0)
    tripped = {
        'emergency_stop': 'true',
        'interlock_state': 'tripped',
        'interlock_cause': 'hunting',
    }
    told.take_speed_status(DRIVE | tripped, 10.0)
    told.take_health({'name': 'rig/bag_recorder', 'level': 'ERROR', 'message': 'disk full'}, 10.0)
    text = drawn(Screen(told.sections(10.1)), 60, 16)
    places = [
        text.index(words)
        for words in (
            'ALARM NOT ACKNOWLEDGED', 'EMERGENCY STOP IS IN FORCE',
            'INTERLOCK TRIPPED, mode measure: hunting', 'bag_recorder ERROR: disk full',
            'v  7.20 m/s',
        )
    ]  # fmt: skip
    assert places == sorted(places)


def test_what_a_topic_says_cannot_move_the_cursor_and_ascii_is_enough() -> None:
    shown = Screen(screen(message='\x1b[2Jgone\nnext').sections, [('\x1b]0;title\x07', '')], KEYS)
    text = drawn(shown)
    assert '\x1b[2J' not in text
    assert '\x1b]' not in text
    console = Console(width=60, height=24, force_terminal=True, color_system=None)
    options = console.options.update(height=24)
    options.encoding = 'ascii'
    rows = console.render_lines(screen(drive={}), options)
    assert ''.join(segment.text for row in rows for segment in row).isascii()
