"""
Take the pictures of the page: `make page-pictures`; it needs playwright and a Chromium.

The rig is simulated, and its detector is the one that runs live; what the other nodes say of
themselves is played. One sheet a state, of the widths of a phone, a tablet, a laptop and two
walls, in few colours: docs/page_live.png and so on, and docs/page.png of the laptop alone.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import sys
import tempfile
import threading
import time
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / 'test' / 'benchmark'))

from detection_rigs import BENCHES, RATE_HZ  # noqa: E402

from hunt_ros.dashboard.access import access  # noqa: E402
from hunt_ros.dashboard.model import PageModel, PageSettings  # noqa: E402
from hunt_ros.dashboard.recordings import Recordings  # noqa: E402
from hunt_ros.dashboard.server import PageServer  # noqa: E402
from hunt_ros.detection import HuntingDetector  # noqa: E402
from hunt_ros.detection.configuration import DetectorConfig  # noqa: E402
from hunt_ros.dynamics.identified import IdentifiedNormalForm  # noqa: E402
from hunt_ros.dynamics.simulation import RollerRig  # noqa: E402

#: Width and height of each browser, pixels, and its place on the sheet: left, top, width.
VIEWS = {
    390: (844, (0, 0, 390)),
    820: (1180, (410, 0, 586)),
    1366: (768, (1016, 0, 884)),
    1920: (1080, (0, 864, 940)),
    3840: (2160, (960, 864, 940)),
}
SHEET, COLOURS = (1900, 1393), 64
#: As often as the status comes, s; running before the first picture, s; speed, m/s.
STEP_S, BEFORE_S, SPEED, SAFE_SPEED = 0.05, 120.0, 7.2, 5.0
ROUGHNESS_M, NOISE_RATIO, SEED = 20e-6, 0.05, 5
#: The first stamp, ns: a Monday at ten.
BEGIN_NS = 1_795_428_000_000_000_000


class PlayedRig:
    """A rig with its detector, shown on a page: in time, or as fast as this machine can."""

    def __init__(self, folder: Path) -> None:
        bench = BENCHES['paper']
        covariance = np.diag([2e-3, 0.0, 0.0, 2e-4, 2e-4, 2e-4])
        form = IdentifiedNormalForm(bench.form, covariance)
        settings = bench.settings(SPEED, bench.broadband(SPEED, NOISE_RATIO), ROUGHNESS_M)
        self.bench, self.roller = bench, RollerRig(bench.rig, settings, seed=SEED)
        self.detector = HuntingDetector(DetectorConfig(), form)
        self.model = PageModel(PageSettings(), form)
        self.server = PageServer(
            '127.0.0.1', 0, access('127.0.0.1', ''), lambda *_: Future(), 'rig', Recordings(folder)
        )
        self.speed = SPEED
        self.speaks, self.playing = True, True
        #: What drive and nodes say of themselves.
        self.drive: dict[str, str] = {}
        self.health: list[dict[str, str]] = []

    def step(self) -> None:
        """Go on by 50 ms."""
        now_s = time.monotonic()
        count = round(STEP_S * RATE_HZ)
        block = self.roller.advance(count, np.full(count, self.speed))
        for name, stamps_ns, values in (
            ('lateral', block.stamps_ns, block.lateral),
            ('yaw', block.stamps_ns, block.yaw),
            ('roller', block.stamps_ns, block.roller_angle),
            ('speed', block.stamps_ns, block.speed),
        ):
            output = self.detector.update(name, BEGIN_NS + stamps_ns, values)
            if name in ('lateral', 'yaw') and self.speaks:
                self.model.take_samples(name, BEGIN_NS + stamps_ns, values)
            for event in output.events:
                told = {key: str(value) for key, value in event.values.items()}
                told |= {'level': event.level.label, 'message': event.cause}
                self.model.take_event(event.stamp_ns, told)
                self.model.take_alarms(json.dumps(self.detector.history.to_json()))
        if self.speaks:
            status = self.detector.status
            told = {key: str(value) for key, value in status.values.items()}
            told |= {'level': status.level.label, 'message': '; '.join(status.reasons)}
            self.model.take_status(status.stamp_ns, told, now_s)
        if self.drive:
            speeds = {'speed_mps': str(block.speed[-1]), 'target_mps': str(self.speed)}
            self.model.take_speed_status(self.drive | speeds, now_s)
        for each in self.health:
            self.model.take_health(each, now_s)
        self.model.take_viewers(1)
        self.server.publish(self.model.view(now_s))

    def run(self, seconds: float) -> None:
        """Go on at once."""
        for _ in range(round(seconds / STEP_S)):
            self.step()

    def play(self) -> None:
        """Go on in time, until `playing` is False (in a thread)."""
        due = time.monotonic()
        while self.playing:
            due += STEP_S
            self.step()
            time.sleep(max(0.0, due - time.monotonic()))


DRIVE = {
    'level': 'OK', 'profile': 'up and down', 'profile_state': 'paused',
    'profile_elapsed_s': '120', 'profile_remaining_s': '386', 'interlock': 'protect',
    'interlock_state': 'armed', 'emergency_stop': 'false', 'interlock_cause': '',
    'safe_speed_mps': str(SAFE_SPEED), 'speed_ceiling_mps': '9.0',
}  # fmt: skip
NODES = [
    {'name': f'rig/{name}', 'level': 'OK', 'message': message, **more}
    for name, message, more in (
        ('bag_recorder', 'recording hunt_20261123_090000', {
            'path': '/lab/hunt_20261123_090000.active', 'recorded_s': '754', 'bytes': '73e6',
            'free_bytes': '61e9'}),
        ('hunting_detector', 'samples taken', {}),
        ('lateral_sensor', '500 samples/s', {'rate_hz': '500'}),
        ('yaw_sensor', '500 samples/s', {'rate_hz': '500'}),
        ('roller_speed', 'holds its speed', {'rate_hz': '100'}),
    )
]  # fmt: skip
REPLAY = {
    'name': 'rig/live_replay', 'level': 'OK', 'bag': 'kick_escapes', 'position_s': '132.3',
    'length_s': '254.0', 'rate': '1.0', 'playing': 'True', 'finished': 'False',
}  # fmt: skip


def prepare(rig: PlayedRig, state: str) -> None:
    """Bring a rig into a state that is worth a picture."""
    if state != 'replay':
        rig.drive, rig.health = dict(DRIVE), NODES
    else:
        rig.health = [REPLAY, NODES[1]]
    rig.run(BEFORE_S)
    if state != 'live':
        rig.bench.kick(rig.roller, 'y', 1.3 * rig.bench.unstable(SPEED))
        rig.run(14.0)
    if state == 'tripped':
        rig.drive |= {
            'level': 'ERROR', 'interlock_state': 'tripped',
            'interlock_cause': 'the detector says ERROR: escaping',
        }  # fmt: skip
        while rig.speed > SAFE_SPEED:
            rig.speed -= 0.5 * STEP_S
            rig.step()
        rig.run(12.0)
    rig.speaks = state != 'silent'


def pictures(state: str) -> dict[int, Image.Image]:
    """Return the page in a state, by its width."""
    found = {}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        rig = PlayedRig(Path(folder))
        prepare(rig, state)
        player = threading.Thread(target=rig.play)
        player.start()
        try:
            place = os.environ.get('CHROMIUM') or shutil.which('chromium')
            browser = driver.chromium.launch(executable_path=place, args=['--no-sandbox'])
            page = browser.new_page()
            for width, (height, _) in VIEWS.items():
                page.set_viewport_size({'width': width, 'height': height})
                page.goto(f'http://127.0.0.1:{rig.server.site.port}/')
                page.wait_for_function('() => figures.waterfall && shown.lateral > 50')
                time.sleep(3.0)
                found[width] = Image.open(io.BytesIO(page.screenshot())).convert('RGB')
            browser.close()
        finally:
            rig.playing = False
            player.join()
            with suppress(RuntimeError):
                rig.server.close()
    return found


def save(image: Image.Image, name: str) -> None:
    """Write a picture in few colours."""
    way, none = Image.Quantize.MAXCOVERAGE, Image.Dither.NONE
    image.quantize(COLOURS, way, kmeans=3, dither=none).save(HERE / name, optimize=True)


def main() -> None:
    """Take them all, or those of the states that are named."""
    for state in sys.argv[1:] or ('live', 'error', 'tripped', 'silent', 'replay'):
        taken = pictures(state)
        sheet = Image.new('RGB', SHEET, '#9a9aa2')
        for width, (height, (left, top, wide)) in VIEWS.items():
            size = wide, round(height * wide / width)
            sheet.paste(taken[width].resize(size, Image.Resampling.LANCZOS), (left, top))
        save(sheet, f'page_{state}.png')
        if state == 'error':
            save(taken[1366], 'page.png')


if __name__ == '__main__':
    main()
