"""The whole report of a simulated run: what is in it, and that it equals the identification."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import pytest
from made import FLUTTER, flutter_runs, held, numbers, rig_settings, up_and_down
from records_made import held_speeds
from report_made import assert_self_contained

from hunt_ros.bag import write_record
from hunt_ros.cli.main import main
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import SimulationSettings, simulate
from hunt_ros.identification import identify
from hunt_ros.report.compose import Report
from hunt_ros.report.events import sentence
from hunt_ros.samples import Record

FIGURES = {
    'run01',
    'fig05a_response',
    'fig05b_response',
    'fig05c_response',
    'fig05d_response',
    'fig06_hysteresis',
    'fig07a_response',
    'fig07b_response',
    'fig10_bifurcation',
}


def staircase() -> Record:
    """Return a run up and down in steps of 0.4 m/s, with roughness, noise and forcing."""
    profile = up_and_down([6.0, 6.4, 6.8, 7.2, 7.6, 8.0, 8.4, 8.8], 25.0)
    settings = rig_settings(200.0, 1e-5, (3e-5,))
    record = simulate(paper_rig(), settings, profile, profile.duration_s, seed=5)
    return Record(dict(record), '', {'operator': '<b>A & B</b>'})


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where `hunt report` has put page, figures and JSON."""
    folder: Path = tmp_path_factory.mktemp('report')
    bag = write_record(folder / 'day & night <1>', staircase())
    words = ['report', str(bag), '--out', str(folder / 'r.html'), '--title', 'Run <7>']
    words += ['--figures', str(folder / 'figures'), '--json', str(folder / 'r.json')]
    html, REPORT[:] = Report.html, []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Report, 'html', lambda one, drawn: REPORT.append(one) or html(one, drawn))
        assert main(words) == 0
    return folder


#: What the command has put on the page.
REPORT: list[Report] = []


@pytest.fixture(scope='module')
def report(folder: Path) -> Report:
    return REPORT[0]


@pytest.fixture(scope='module')
def page(folder: Path) -> str:
    return (folder / 'r.html').read_text(encoding='utf-8')


def test_every_number_of_the_page_is_of_the_identification_or_an_event(
    report: Report, page: str
) -> None:
    known = {x for events in report.events.values() for event in events
              for x in event.numbers.values()}  # fmt: skip
    known |= set(numbers(report.document))
    values = assert_self_contained(page).values
    assert {report.identification.v_c.value, report.identification.observed.v_c} <= values
    assert values <= known


def test_a_verdict_on_each_speed_that_was_held_stands_in_the_report(report: Report, page) -> None:
    held = report.document['clearances']
    verdicts = [(round(one['speed_mps'], 1), one['cleared']) for one in held]
    assert [speed for speed, _ in verdicts[:8]] == [6.0, 6.4, 6.8, 7.2, 7.6, 8.0, 8.4, 8.8]
    assert verdicts[0] == verdicts[-1] == (6.0, True)
    # Where it hunts on the way down, too, and from v_c on; just below either may be.
    assert not any(is_cleared for _, is_cleared in verdicts[5:14])
    assert page.count('<b>not cleared</b>') == sum(not one['cleared'] for one in held)
    above = next(one for one in held if one['speed_mps'] > 8.5)
    assert 'limit cycle' in above['reason']


def test_the_json_in_the_page_and_beside_it_is_that_of_the_identification(
    report: Report, folder: Path, page: str
) -> None:
    found = re.search(r'id="identification">(.*?)</script>', page, re.DOTALL)
    assert found
    document = json.loads(found.group(1))
    assert document == report.document == json.loads((folder / 'r.json').read_text())
    assert document.items() >= report.identification.to_json().items()


def test_the_figures_of_the_paper_are_on_the_page_and_in_the_folder(
    folder: Path, page: str
) -> None:
    files = list((folder / 'figures').iterdir())
    assert {path.stem for path in files} >= FIGURES
    for path in files:
        if path.suffix == '.svg':
            ElementTree.parse(path)
        else:
            assert path.read_bytes().startswith(b'\x89PNG')
    for number in ('5a', '5b', '5c', '5d', '6', '7a', '7b', '10'):
        assert f'<b>Fig. {number}</b>' in page
    svgs = len([path for path in files if path.suffix == '.svg'])
    assert page.count('<svg ') == page.count('</svg>') == svgs
    assert not list(folder.glob('*.part'))


def test_the_events_of_the_run_are_in_the_table_and_in_the_figure(
    report: Report, page: str
) -> None:
    ((_, events),) = report.events.items()
    begin = report.identification.records[0].start_ns
    words = [sentence(event.event) for event in events]
    assert 'LIMIT CYCLE: full hunting' in words
    table = page[page.index('id="events"') : page.index('id="hysteresis"')]
    rows = re.findall(r'<tr><th scope="row">.*?</tr>', table)
    assert len(rows) == len(events)
    for row, event, word in zip(rows, events, words, strict=True):
        assert word in row
        assert f'{(event.stamp_ns - begin) / 1e9:.2f}' in row
        assert event.level.label in row


def test_every_warning_and_every_null_is_on_the_page(report: Report, page: str) -> None:
    from html import escape

    for line in report.identification.notices:
        assert escape(line) in page
    for key, reason in report.identification.unknown.items():
        assert f'<code>{key}</code>' in page
        assert escape(reason) in page


def test_what_people_wrote_into_the_recording_is_text_on_the_page(page: str) -> None:
    assert '<b>A & B</b>' not in page
    assert '&lt;b&gt;A &amp; B&lt;/b&gt;' in page
    assert 'day &amp; night &lt;1&gt;' in page
    assert '<h1>Run &lt;7&gt;</h1>' in page


def test_the_four_states_are_those_of_the_paper(report: Report) -> None:
    a, b, c, d = (report.chosen[letter] for letter in 'abcd')
    assert a.speed < b.speed < c.speed
    assert abs(b.speed - d.speed) < 0.1
    assert (b.direction, d.direction) == ('up', 'down')
    assert d.amplitude > 3.0 * b.amplitude
    # Fig. 5: a closed curve where it hunts.
    assert report.responses['c'].kind == 'quasi-periodic'


def test_a_quiet_run_makes_a_report_that_says_what_cannot_be_known() -> None:
    settings = SimulationSettings(sample_rate_hz=100.0, initial_speed=6.2, broadband=8e-6)
    record = simulate(paper_rig(), settings, held(6.2), 60.0, seed=1)
    one = Report(identify([record]))
    assert one.identification.normal_form is None
    page = one.html(one.drawings())
    assert page.count('not known') > 10
    assert '<b>Fig. 10</b>' not in page
    for word in ('None', 'nan'):
        assert not re.search(rf'>\s*{word}\s*<', page)


def test_the_hunting_line_is_that_of_the_rig_whatever_its_frequency() -> None:
    form = replace(PAPER_NORMAL_FORM, frequency_hz=7.5)
    record = held_speeds([6.0, 6.8, 7.2, 8.6], 40.0, 4.0, 1, form=form, forcing=4e-6)
    report = Report(identify(record))
    spectrum = report.responses['d'].spectrum
    assert spectrum is not None
    line = spectrum.line('hunting')
    assert line is not None
    assert line.frequency_hz == pytest.approx(7.5, abs=0.2)


@pytest.mark.skipif(not FLUTTER.is_dir(), reason='the flutter-rig recordings are not there')
def test_a_campaign_on_a_real_rig_claims_no_fold_and_draws_what_was_measured() -> None:
    report = Report(identify(flutter_runs('17092018_CBC_V???_*HB.mat')))
    page = report.html(report.drawings())
    # The quintic form does not fit this rig: no fold may be claimed.
    assert report.identification.v_n is None
    # Nothing but limit cycles: they show no critical speed, below them or above.
    assert report.identification.v_c is None
    assert 'Down to which speed hunting persists is <a class="unknown"' in page
    # The limit cycle grows from 21 to 137 mm over the campaign, nearly in a line.
    amplitudes = [state.amplitude for state in report.identification.steady_states]
    assert len(amplitudes) >= 20
    assert 0.02 < min(amplitudes) < max(amplitudes) < 0.15
    assert set(amplitudes) <= assert_self_contained(page).values
    assert '<b>Fig. 6</b>' in page
    # There is no roller: nothing may be called its roughness.
    assert all(
        one.spectrum is not None and one.spectrum.line('roughness') is None
        for one in report.responses.values()
    )
    # Nor is there a revolution to cut at: a limit cycle is a point in its own section.
    for response in report.responses.values():
        assert response.kind == 'periodic'
        assert response.section is not None
        assert response.section.cut == 'hunting'
    assert 'one point a hunting cycle' in page
