"""How the nodes of the suite are started."""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping, Sequence
from pathlib import Path

from hunt_ros.cli.support.processes import NodeSpec, for_ros
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.dynamics.profile import Motion, Profile
from hunt_ros.suite import GUARDS, PAGE, PAGE_PORT, SIMULATOR, SOURCES, SUITE

#: In fast simulated time a pause of the machine looks that much longer: the most that a channel
#: may be silent, s of the rig, and the detector, s: simulated time waits for it so long.
_SENSOR_PATIENCE_S, _DETECTOR_PATIENCE_S = 3.0, 60.0

Parameters = Mapping[str, Mapping[str, object]]


def free_port() -> int:
    """Return a TCP port of the loopback interface that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


def simulated_run(
    folder: Path,
    profile: Profile,
    pace: float,
    kicks: Sequence[tuple[float, float]],
    seed: int = 1,
) -> dict[str, dict[str, object]]:
    """
    Return the parameters of each node for a profile on the simulated rig, recorded.

    Parameters
    ----------
    folder : Path
        Gets the profile and the recording.
    profile : Profile
        Begins when the speed node does.
    pace : float
        Seconds of the rig in a second.
    kicks : sequence of (float, float)
        Time, s, and size, m, of the bumps.
    seed : int
        Of everything random.
    """
    path = folder / 'profile.yaml'
    path.write_text(profile.to_yaml(), encoding='utf-8')
    port = free_port()
    rate: dict[str, object] = {'sample_rate_hz': 200.0, 'port': port}
    return {
        SIMULATOR: {
            **rate,
            'time_scale': float(pace),
            'initial_speed_mps': profile.steps[0].begin_mps(Motion()),
            'kicks': [number for kick in kicks for number in kick],
            'seed': seed,
            'start_with_readers': len(SOURCES),
        },
        'lateral_sensor': rate,
        'yaw_sensor': rate,
        'roller_speed': {
            'port': port,
            'profile': str(path),
            'profile_autostart': True,
            # A limit cycle is what the sweep is for.
            'interlock': 'measure',
            'status_timeout_s': _DETECTOR_PATIENCE_S,
            'slow_down_at_end': False,  # the rig ends with it
        },
        # Fewer estimates a simulated second keep the machine free.
        'hunting_detector': {'output_rate_hz': 20.0, 'sensor_timeout_s': _SENSOR_PATIENCE_S},
        'bag_recorder': {'directory': str(folder), 'rig_name': 'simulated'},
        'normal_form_identifier': {'directory': str(folder)},
    }


def start_nodes(
    supervisor: Supervisor,
    names: Sequence[str],
    common: Mapping[str, object],
    parameters: Parameters,
    files: Sequence[Path] = (),
    one_process: bool = False,
) -> None:
    """
    Start nodes by name.

    Parameters
    ----------
    supervisor : Supervisor
        The run.
    names : sequence of str
        Executables.
    common : mapping
        Parameters of all of them.
    parameters : mapping of str to mapping
        Parameters of each, by node name.
    files : sequence of Path
        ROS parameter files for all of them.
    one_process : bool
        True for all but the guards in one process, which takes less memory and less CPU.
    """
    # A file, for one on a command line does not win over the section of its node in another file.
    sections = {
        f'/**/{name}': {'ros__parameters': {**common, **parameters.get(name, {})}}
        for name in names
    }
    text = for_ros(json.dumps(sections, ensure_ascii=False))
    own = supervisor.in_memory(f'{names[0]}.yaml', text.encode())
    alone = [name for name in names if name in GUARDS] if one_process else names
    for name in alone:
        supervisor.start(NodeSpec(name, {}, [*files, own]))
    if together := [name for name in names if name not in alone]:
        supervisor.start(NodeSpec(SUITE, {}, [*files, own], nodes=together))


def start_page(
    supervisor: Supervisor,
    port: int,
    folder: Path,
    common: Mapping[str, object],
    files: Sequence[Path],
) -> str:
    """Start the page of the operator, at its usual port for 0; say where it is."""
    port = port or PAGE_PORT
    own = {PAGE: {'port': port, 'directory': str(folder)}}
    start_nodes(supervisor, [PAGE], common, own, files)
    return f'page: http://127.0.0.1:{port}/'
