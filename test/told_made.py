"""What a rig says of itself, as its topics tell it, and questions to the page that shows it."""

from __future__ import annotations

import json
import urllib.error
import urllib.request

import numpy as np

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

#: The normal form of the paper, with a critical speed that is known to 0.03 m/s.
FORM = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([1e-3, 0, 0, 0, 0, 0]))
#: Of the detector, at 7.2 m/s.
STATUS = {
    'level': 'WARN',
    'name': 'hunting',
    'message': 'hysteresis region: a disturbance can start hunting; low margin: 2.1',
    'state': 'quiet',
    'region': 'hysteresis',
    'alarm': 'False',
    'speed_mps': '7.2',
    'amplitude_m': '2e-05',
    'amplitude_std_m': '1e-06',
    'unstable_amplitude_m': '4.2e-4',
    'stable_amplitude_m': '2.1e-3',
    'growth_rate_per_s': 'nan',
    'escape_probability': '0.0004',
    'margin': 'inf',
    'frequency_hz': '2.8',
    'v_n_mps': '6.4',
    'v_c_mps': '8.0',
    'normal_form': FORM.words,
}
#: Of the speed node.
DRIVE = {
    'level': 'OK',
    'speed_mps': '7.2',
    'target_mps': '7.25',
    'profile': 'sweep',
    'profile_state': 'idle',
    'interlock': 'protect',
    'interlock_state': 'armed',
    'interlock_cause': '',
    'emergency_stop': 'false',
}
#: Of a replay on `/diagnostics`.
REPLAY = {
    'name': 'rig/live_replay', 'level': 'OK', 'bag': 'day_3', 'position_s': '12.34',
    'length_s': '254.0', 'rate': '0.1', 'playing': 'True', 'finished': 'False',
}  # fmt: skip


def ask(url: str, body: object = None, opener=None, **headers: str) -> tuple[int, str]:
    """Return status and text of an answer; a body is sent as JSON."""
    data = None if body is None else json.dumps(body).encode()
    kind = {} if body is None else {'Content-Type': 'application/json'}
    names = {name.replace('_', '-'): value for name, value in headers.items()}
    request = urllib.request.Request(url, data, {**kind, **names})
    try:
        with (opener or urllib.request.build_opener()).open(request, timeout=60) as answer:
            return answer.status, answer.read().decode(errors='surrogateescape')
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()
