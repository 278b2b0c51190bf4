"""What the terminal shows of a rig, drawn without a terminal."""

from __future__ import annotations

import pytest
import told_made
from rich.cells import cell_len
from rich.console import Console, Group

from hunt_ros.cli.support.screen import rows
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


def screen(now_s: float = 10.1, drive: dict | None = None, **status: str) -> dict:
    """Return what is told of a rig that said all this at 10 s, at a moment."""
    told = Told()
    told.take_status(100 * 10**9, STATUS | status, 10.0)
    if drive is not None:
        told.take_speed_status(DRIVE | drive, 10.0)
    told.take_health({'name': 'rig/yaw_sensor', 'level': 'OK'}, 10.0)
    return told.sections(now_s)


def drawn(sections: dict, width: int = 80, colour: str | None = None) -> str:
    """Return what a terminal of this width shows."""
    console = Console(width=width, force_terminal=True, color_system=colour)
    with console.capture() as capture:
        console.print(Group(*rows(sections, KEYS, width)))
    return capture.get()


@pytest.mark.parametrize('width', [12, 30, 60, 80, 200])
@pytest.mark.parametrize('silent', [False, True])
def test_it_fits_every_terminal_and_the_level_comes_first(width, silent) -> None:
    shown = screen(14.0 if silent else 10.1, drive={'profile': 'x' * 300}, message='y ' * 400)
    text = drawn(shown, width)
    assert all(cell_len(row) <= width for row in text.split('\n'))
    assert ('STALE' if silent else 'WARN') in text.split('\n')[0]


def test_sixty_columns_hold_all_that_counts() -> None:
    text = ' '.join(drawn(screen(drive={}), 60).split())
    for words in (
        'WARN for 5 s quiet, hysteresis region', 'a disturbance can start hunting',
        'low margin: 2.1', 'speed v 7.20 m/s', 'set point 7.25', 'v_n 6.40', 'v_c 8.00',
        '0.200 mm (± 0.010)', 'profile sweep: running, 25 %, 1:30 min left',
        'interlock armed, mode measure', *KEYS,
    ):  # fmt: skip
        assert words in text, words


@pytest.mark.parametrize('level', ['OK', 'WARN', 'ERROR'])
def test_without_colour_the_level_is_a_word(level, monkeypatch) -> None:
    monkeypatch.setenv('NO_COLOR', '1')
    plain = drawn(screen(level=level), colour='truecolor')
    assert level in plain
    assert not any(f'\x1b[{code}' in plain for code in ('3', '4', '1;3', '38', '48', '1;7;3'))
    monkeypatch.delenv('NO_COLOR')
    assert '\x1b[1;7;3' in drawn(screen(level=level), colour='truecolor')


def test_a_silent_detector_is_loud_and_none_of_its_numbers_is_shown_as_true() -> None:
    text = drawn(screen(13.0, drive={}, level='OK'), 60)
    first, *_ = text.splitlines()
    assert 'STALE' in first
    assert 'NO WORD FROM THE DETECTOR' in first
    assert 'silent for 3 s: nothing here is up to date' in text
    assert 'last word: OK, quiet' in text
    assert 'THE SPEED NODE IS SILENT' in text
    for words in ('7.20', '0.200', 'v_n', 'A_u', 'armed', '25 %'):
        assert words not in text, words
    before = drawn(Told().sections(5.0))
    assert 'STALE' in before
    assert 'q: quit' in before


def test_stale_inputs_of_a_detector_that_speaks_say_why() -> None:
    text = drawn(screen(level='STALE', message='lateral: silent for 0.4 s', amplitude_m='nan'))
    assert 'STALE' in text.splitlines()[0]
    assert 'lateral: silent for 0.4 s' in text
    assert 'amplitude of y –' in text


def test_a_form_that_is_absent_or_replaced_is_shown_as_it_is() -> None:
    none = dict.fromkeys(
        ('v_n_mps', 'v_c_mps', 'unstable_amplitude_m', 'stable_amplitude_m'), 'nan'
    )
    text = drawn(screen(normal_form='', region='unknown', **none))
    assert 'region unknown' in text
    assert 'v_n − v –' in text
    other = drawn(screen(normal_form='v_c 7.900 m/s', v_n_mps='nan', v_c_mps='7.9'))
    assert 'v_c 7.90' in other
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
    text = drawn(told.sections(10.1), 60)
    places = [
        text.index(words)
        for words in (
            'ALARM NOT ACKNOWLEDGED', 'EMERGENCY STOP IS IN FORCE, until rearmed',
            'INTERLOCK TRIPPED, mode measure, until rearmed', 'bag_recorder ERROR: disk full',
            'speed v 7.20 m/s',
        )
    ]  # fmt: skip
    assert places == sorted(places)


def test_what_a_topic_says_cannot_move_the_cursor() -> None:
    text = drawn(screen(message='\x1b[2Jgone\nnext', drive={'profile': '\x1b]0;title\x07'}))
    assert '\x1b[2J' not in text
    assert '\x1b]' not in text
