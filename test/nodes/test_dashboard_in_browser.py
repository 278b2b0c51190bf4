"""The page in a real browser, with the real nodes behind it, each in a process of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip('tornado', reason='the extra dashboard is not installed')

from std_msgs.msg import String

from hunt_ros.cli.support.suite import free_port
from hunt_ros.nodes.support.qos import STATUS, latched, stream

pytestmark = [pytest.mark.ros, pytest.mark.slow]

#: Of the sensors: five times fewer samples than usual leave a busy machine room for the browser.
_RATE_HZ = 100.0
#: Inside the hysteresis region: a bump decides.
_SPEED_MPS, _KICK_M = 7.2, 0.0006
#: Statuses of level ERROR that the page may get before it says so: those of half a second.
_MOST_STATUSES = 10
#: Notes how many statuses of level ERROR have come when the page says so, and when that is.
_WATCH_FOR_ERROR = """() => {
  window.alarm = {statuses: 0};
  const before = apply;
  apply = (message) => {
    if (message.sections?.status?.level === 'ERROR') alarm.statuses += 1;
    before(message);
  };
  new MutationObserver(() => {
    if (byId('word').textContent !== 'ERROR') return;
    alarm.shown ??= {statuses: alarm.statuses, ms: Date.now()};
  }).observe(byId('word'), {childList: true, subtree: true});
}"""


class Rig:
    """The simulated rig with every node that the page shows, and the page."""

    def __init__(self, graph, new_page) -> None:
        self.graph = graph
        self._port = free_port()
        self._form = Path(__file__).parents[2] / 'bags' / 'paper.yaml'
        self.statuses = graph.told('hunting/status', STATUS)
        self._drives = graph.told('speed/status', latched())
        # A machine that is busy must not look like nodes that are silent.
        self._patience_s = 0.5 * graph.machine.measure()
        self.start('hunting_detector')
        self.start('bag_recorder')
        self.start('dashboard')
        graph.start(
            'rig_simulator',
            port=graph.port,
            sample_rate_hz=_RATE_HZ,
            start_with_readers=3,
            initial_speed_mps=6.8,
            kick_m=_KICK_M,
        )
        for name in ('lateral_sensor', 'yaw_sensor', 'roller_speed'):
            self.start(name)
        graph.spin_until(lambda: self.drive and self.status.get('region') == 'hysteresis', 120.0)
        self.page = new_page()
        self.page.goto(f'http://127.0.0.1:{self._port}/')
        self.until("figures.waterfall && document.body.dataset.link === 'up'")
        self.page.errors.clear()

    def start(self, module: str) -> None:
        graph = self.graph
        if module == 'hunting_detector':
            # The diameter as a rig file has it: else it is learnt, of samples that were held up.
            known = {'sensor_timeout_s': self._patience_s, 'roller_diameter_m': 0.3}
            graph.start(module, self._form, **known)
        elif module == 'bag_recorder':
            graph.start(module, directory=graph.folder / 'recordings')
        elif module == 'dashboard':
            own = {'directory': graph.folder / 'recordings', 'port': self._port}
            graph.start(module, self._form, **own)
        elif module == 'roller_speed':
            hold = f'hold: {{speed_mps: {_SPEED_MPS}, duration_s: 100000, rate_mps2: 0.5}}'
            # These tests look at the page: nothing but its buttons shall slow the roller down.
            free = {'interlock': "'off'", 'profile': graph.profile(hold)}
            graph.start(module, port=graph.port, **free)
        else:
            graph.start(module, port=graph.port, sample_rate_hz=_RATE_HZ)

    @property
    def status(self) -> dict[str, str]:
        """What the detector said last."""
        return self.statuses.last

    @property
    def drive(self) -> dict[str, str]:
        """What the speed node said last."""
        return self._drives.last

    def until(self, shown: str) -> None:
        """Wait until this holds on the page: an expression of its script."""
        self.graph.spin_until(lambda: self.page.evaluate(f'() => Boolean({shown})'), 60.0)

    def until_word(self, level: str) -> None:
        """Wait until this is the level on the page."""
        self.until(f"document.getElementById('word')?.textContent === '{level}'")

    def press(self, button: str) -> None:
        """Press a button of the page as long as it wants, and wait for its answer: done."""
        self.forget_answer()
        if self.page.get_attribute(button, 'data-hold') is None:
            self.page.click(button)
            self.answered()
        else:
            self.page.hover(button)
            self.page.mouse.down()
            self.answered()
            self.page.mouse.up()

    def forget_answer(self) -> None:
        """Take the last answer from the page: what comes next is the answer to what comes next."""
        self.page.evaluate(
            "() => { byId('answer').hidden = true; byId('answer').className = ''; }"
        )

    def answered(self) -> None:
        """Wait until the page says that what was asked for last is done."""
        self.until("byId('answer').className")
        done = self.page.get_attribute('#answer', 'class') == 'done'
        assert done, self.page.inner_text('#answer')

    def until_drive(self, **values: str) -> None:
        """Wait until the speed node says so."""
        self.graph.spin_until(lambda: values.items() <= self.drive.items())

    def point(self) -> list[float]:
        """Return speed (m/s) and amplitude (mm) of the point in the diagram."""
        return self.page.evaluate('() => shown.point || [NaN, NaN]')


@pytest.fixture
def rig(graph, new_page) -> Rig:
    return Rig(graph, new_page)


def test_the_point_moves_a_kick_is_an_alarm_and_every_button_acts(
    rig, graph, record_property
) -> None:
    page = rig.page
    marks = graph.collect(String, 'recording/mark', stream(10))
    names = graph.collect(String, 'hunting/acknowledged_by', stream(10))
    closed = graph.collect(String, 'recording/closed', latched())
    rig.until_word('WARN')
    assert 'hysteresis' in page.inner_text('#state')

    before = rig.point()
    rig.press('text=start profile')
    rig.until_drive(profile_state='running')
    graph.spin_until(lambda: rig.point()[0] > before[0] + 0.1)
    rig.press('text=pause profile')
    rig.until_drive(profile_state='paused')
    rig.press('text=resume profile')
    rig.until_drive(profile_state='running')
    graph.spin_until(lambda: rig.point()[0] > _SPEED_MPS - 0.1)
    trail = page.evaluate('() => streams.trail.rows.map((row) => row[0])')
    assert len(trail) > 5
    assert max(trail) > min(trail) + 0.1, 'it has left its way behind'

    page.evaluate(_WATCH_FOR_ERROR)
    heard = len(rig.statuses)
    assert graph.call('simulator/kick').success
    rig.until('alarm.shown')
    shown = page.evaluate('() => alarm.shown')
    assert shown['statuses'] <= _MOST_STATUSES
    graph.spin_until(lambda: rig.status['level'] == 'ERROR')
    first = next(one for one in rig.statuses[heard:] if one['level'] == 'ERROR')
    late_s = shown['ms'] / 1e3 - int(first['stamp_ns']) / 1e9
    record_property('from_alarm_to_page_s', late_s)
    print(f'from the stamp of the first ERROR to the word on the page: {late_s:.3f} s')
    graph.spin_until(lambda: rig.point()[1] > 0.5)
    assert page.inner_text('#why').strip()

    rig.forget_answer()
    page.click('text=acknowledge alarm')
    page.fill('#operator', 'Mia')
    page.keyboard.press('Enter')
    rig.answered()
    graph.spin_until(lambda: names)
    assert names[-1].data == 'Mia'
    rig.until("byId('alarms').textContent.includes('acknowledged by Mia')")
    page.fill('#words', 'bump at joint 3')
    rig.press('text=mark >> visible=true')
    graph.spin_until(lambda: 'bump at joint 3' in [mark.data for mark in marks])

    rig.press('#emergency')
    rig.until_drive(emergency_stop='true', profile_state='paused')
    rig.until("byId('holds').textContent.includes('EMERGENCY STOP IS IN FORCE')")
    rig.press('#rearm')
    rig.until_drive(emergency_stop='false')
    rig.forget_answer()
    page.keyboard.press('Escape')
    rig.answered()
    rig.until_drive(emergency_stop='true')

    page.click('summary')
    rig.press('text=stop recording')
    graph.spin_until(lambda: closed)
    rig.until("byId('recorder').textContent.includes('NOT RECORDING')")
    page.click('footer a')
    rig.until("document.querySelector('td a[href^=file]')")
    assert page.errors == []


def test_the_page_comes_back_when_the_detector_and_its_own_node_are_started_again(rig) -> None:
    page, graph = rig.page, rig.graph
    rig.until_word('WARN')
    page.evaluate('() => { window.same = true; }')
    graph.end('hunting_detector')
    rig.until_word('STALE')
    rig.until("document.body.dataset.link === 'silent'")
    rig.start('hunting_detector')
    rig.until_word('WARN')
    rig.until("document.body.dataset.link === 'up'")

    graph.end('dashboard')
    rig.until("document.body.dataset.link === 'lost'")
    rig.until_word('STALE')
    heard = len(rig.statuses)
    rig.start('dashboard')
    rig.until("document.body.dataset.link === 'up'")
    rig.until_word('WARN')
    graph.spin_until(lambda: rig.point()[0] == pytest.approx(6.8, abs=0.1))
    assert len(rig.statuses) > heard, 'the detector did not notice'
    assert page.evaluate('window.same'), 'by itself, and without loading the page again'
