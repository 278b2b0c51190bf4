"""
A recording in the live view, in a process of its own.

The samples go through a detector and into the model of the page without ROS: no topic, no clock
and no namespace is shared with a rig that runs, so a replay can neither disturb it nor be taken
for it by another node. (`hunt replay --live` plays to the running nodes, and refuses to where a
rig publishes.) A live run is repeated from its journal, with its settings and its normal form:
the page shows what it showed then. Another recording is judged anew, with the newest normal form
that rests on it.

The process reads orders from standard input, lines of JSON: the first says what is to be
played (`recording`, `form`), each may say `rate`, `playing` and `at_s`. It prints what a viewer
is sent: lines of JSON. Going back begins anew, and going forward takes no step out: what the
detector says at a moment depends on all that was before. The recording is read once, at the
beginning; what becomes of its files later does not matter.
"""

from __future__ import annotations

import json
import math
import os
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag import check_units, read_record
from hunt_ros.bag.messages import read_texts
from hunt_ros.bag.reader import Bag
from hunt_ros.bag.replay_schedule import FASTEST, SLOWEST
from hunt_ros.dashboard.model import PageModel, PageSettings
from hunt_ros.dashboard.view import Section, View, changes
from hunt_ros.detection import DetectorConfig, HuntingDetector
from hunt_ros.detection.offline import config_for
from hunt_ros.detection.output import PUBLIC, Output
from hunt_ros.detection.record_frequency import frequency_for
from hunt_ros.detection.replay import Playback
from hunt_ros.detection.words import published
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import HuntError
from hunt_ros.recorded_run import recorded_run
from hunt_ros.samples import NANOSECONDS
from hunt_ros.sensors import DISPLACEMENTS

#: Updates of a viewer; the node of the page sends as many.
_UPDATE_S = 0.05
#: Going to a place: so much at once, so that the way is seen, s of the recording.
_STEP_S = 2.0
#: A status in so many ns of the stamps: those of the detector node.
_STATUS_NS = NANOSECONDS // 20
#: What is drawn of the status over time.
_DRAWN = (
    'speed', 'lateral_amplitude', 'lateral_envelope', 'yaw_amplitude', 'yaw_envelope',
)  # fmt: skip
_FORM = 'hunting/normal_form'


class Player:
    """
    One recording, from its beginning on.

    Parameters
    ----------
    recording : Path
        Folder or file.
    form : Path, optional
        Parameter file for a recording that holds no live run.

    Raises
    ------
    HuntError
        If the recording, or the form, cannot be read.
    """

    def __init__(self, recording: Path, form: Path | None = None) -> None:
        self._record = check_units(read_record(recording))
        if not set(DISPLACEMENTS) & set(self._record):
            raise HuntError(f'{recording.name}: neither {" nor ".join(DISPLACEMENTS)} in it')
        live = recorded_run(recording)
        self._journal = () if live is None else tuple(live.journal)
        if live is not None:
            self._config, self._form = live.config, None
            self.source = 'the live run, repeated'
        else:
            self._form, of = _form_of(recording, form)
            config, _ = config_for(self._record, DetectorConfig())
            self._config, _ = frequency_for(self._record, config, known=self._form is not None)
            self.source = f'no live run in it: judged anew, {of}'
        self.began_s = self._record.start_ns / NANOSECONDS
        self.generation = 0
        self.at_s = 0.0
        self._begin()

    @property
    def length_s(self) -> float:
        """Time of the last sample, s."""
        return self._playback.length_ns / NANOSECONDS

    def go(self, to_s: float) -> None:
        """Play up to a time; from the beginning where that has passed."""
        to_s = min(max(to_s, 0.0), self.length_s)
        if to_s < self.at_s:
            self._begin()
        before, self.at_s = self.at_s, to_s
        # At the end the detector is told that no more comes.
        until_ns = round(to_s * NANOSECONDS) if to_s < self.length_s else self._playback.length_ns
        self._show_samples(round(before * NANOSECONDS), until_ns)
        self._show(self._playback.advance(until_ns))

    def view(self) -> View:
        """Return what is to be shown now."""
        return self._model.view(self.at_s)

    def _begin(self) -> None:
        """Put detector and page back to the beginning of the recording."""
        c = self._config
        settings = PageSettings(
            lines=c.lines,
            roller_diameter_m=c.roller_diameter_m,
            wheel_diameter_m=c.wheel_diameter_m,
        )
        self._model = PageModel(settings, self._form)
        self._detector = HuntingDetector(c, self._form)
        self._playback = Playback(self._detector, self._record, self._journal)
        self._shown_ns = -_STATUS_NS
        self.at_s = 0.0
        self.generation += 1
        told = {'name': 'hunting_detector', 'level': 'OK', 'forecast_v_c': 'made live only'}
        self._model.take_health(told, 0.0)

    def _show_samples(self, from_ns: int, until_ns: int) -> None:
        """Show the samples after one time up to another; the first also where it is 0."""
        for name in DISPLACEMENTS:
            if name in self._record:
                times = self._playback.times_ns[name]
                begin = 0 if from_ns == 0 else int(np.searchsorted(times, from_ns, 'right'))
                span = slice(begin, int(np.searchsorted(times, until_ns, 'right')))
                series = self._record[name]
                stamps, values = series.stamps_ns[span], series.values[span]
                self._model.take_samples(name, stamps, values)

    def _show(self, output: Output) -> None:
        """Hand to the page what the detector has said."""
        for entry in output.journal:
            if entry.kind in ('start', 'normal_form') and entry.text:
                self._model.take_form(entry.text)
        for event in output.events:
            told = published.texts(event.level.label, event.cause, published.event_values(event))
            self._model.take_event(event.stamp_ns, told)
        if output.events:
            self._model.take_alarms(self._detector.history.to_text())
        status = self._detector.status
        told = published.texts(
            status.level.label, published.status_message(status), published.status_values(status)
        )
        for row in self._spaced(output.estimates):
            numbers = {PUBLIC.get(name, name): str(float(row[name])) for name in _DRAWN}
            self._model.take_status(int(row['stamp_ns']), {**told, **numbers}, self.at_s)
        self._model.take_status(status.stamp_ns, told, self.at_s)

    def _spaced(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Return the rows that begin another period of the status, but for the last."""
        if not rows.size:
            return rows
        periods = rows['stamp_ns'] // _STATUS_NS
        first = np.flatnonzero(np.diff(periods, prepend=self._shown_ns // _STATUS_NS))
        self._shown_ns = int(rows['stamp_ns'][-1])
        return rows[first]


def _form_of(recording: Path, path: Path | None) -> tuple[IdentifiedNormalForm | None, str]:
    """Return the form that judges a recording without a live run, and which it is, in words."""
    if path is not None:
        text = path.read_text(encoding='utf-8')
        return IdentifiedNormalForm.from_yaml(text, str(path)), f'with {path.name}'
    with Bag(recording) as bag:
        texts = read_texts(bag, _FORM)
    if texts:
        form = IdentifiedNormalForm.from_yaml(texts[-1].text, f'{recording.name}: {_FORM}')
        return form, 'with the normal form that it holds'
    return None, 'without a normal form'


class _Orders:
    """What the viewer asks for."""

    def __init__(self) -> None:
        self._lines: SimpleQueue[str] = SimpleQueue()
        first = json.loads(sys.stdin.readline())
        self.recording = Path(first['recording'])
        self.form = Path(first['form']) if first.get('form') else None
        self.rate, self.playing = 1.0, True
        #: Where to go without showing each moment on the way, s; None: nowhere.
        self.at_s: float | None = None
        self._take(first)
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            self._lines.put(line)
        os._exit(0)  # nobody looks any more

    def _take(self, order: Mapping[str, Any]) -> None:
        if 'rate' in order:
            self.rate = min(max(float(order['rate']), SLOWEST), FASTEST)
        if 'playing' in order:
            self.playing = bool(order['playing'])
        if 'at_s' in order and math.isfinite(float(order['at_s'])):
            self.at_s = max(0.0, float(order['at_s']))

    def look(self, player: Player) -> None:
        """Take the orders that have come; to play on at the end begins anew."""
        try:
            while True:
                order = json.loads(self._lines.get_nowait())
                self._take(order)
                if order.get('playing') and player.at_s >= player.length_s:
                    self.at_s = 0.0
        except Empty:
            pass


def play(orders: _Orders) -> None:
    """Play what is ordered, until standard input ends."""
    name = orders.recording.name
    _say({'replay': {'name': name, 'problem': '', 'reading': True}})
    try:
        player = Player(orders.recording, orders.form)
    except (HuntError, OSError) as error:
        problem = ' '.join(str(error).split())
        _say({'replay': {'name': name, 'problem': problem, 'reading': False}})
        return
    has, generation, version = View(), 0, 0
    last_s = time.monotonic()
    while True:
        time.sleep(max(0.0, last_s + _UPDATE_S - time.monotonic()))
        orders.look(player)
        now_s = time.monotonic()
        # A machine that cannot keep up plays slower, and leaves nothing out.
        passed_s, last_s = min(now_s - last_s, 4 * _UPDATE_S), now_s
        if orders.at_s is not None:
            goal = min(orders.at_s, player.length_s)
            begin = 0.0 if goal < player.at_s else player.at_s
            player.go(min(goal, begin + _STEP_S))
            if player.at_s >= goal:
                orders.at_s = None
        elif orders.playing:
            player.go(player.at_s + orders.rate * passed_s)
            orders.playing = player.at_s < player.length_s
        version += 1
        replay = {
            'name': name, 'problem': '', 'reading': False, 'source': player.source,
            'at_s': round(player.at_s, 2), 'length_s': round(player.length_s, 2),
            'rate': orders.rate, 'playing': orders.playing, 'goes_to_s': orders.at_s,
            'began_s': player.began_s,
        }  # fmt: skip
        view = player.view()
        # What a new beginning has not said yet is not left from before it.
        nothing = {each: Section(0, []) for each in ('events', 'alarms')}
        sections = {**nothing, **view.sections, 'replay': Section(version, replay)}
        view = View(sections, view.streams)
        if player.generation != generation:
            has, generation = View(), player.generation
        print(json.dumps(changes(has, view), allow_nan=False, separators=(',', ':')), flush=True)
        has = view


def _say(sections: Mapping[str, Any]) -> None:
    print(json.dumps({'sections': sections, 'streams': {}}), flush=True)


if __name__ == '__main__':
    os.nice(10)  # what is live goes first
    play(_Orders())
