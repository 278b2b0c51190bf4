"""
The hardware of the gauntlet: a rig, its sensors, its drive and their cables, which all may fail.

    python gauntlet_rig.py PORT SEED SPEED_MPS TRUTH.npz

A process of its own that outlives the suite. It obeys lines of JSON on its standard input
(`[what, value, ...]`), answers each with a line, and notes what the wheelset and the roller truly
do. It runs in real time: the guards count on the clocks of the machine, and a faster rig would
forgive them their delay.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hunt_ros.drivers.simulated import Channel
from hunt_ros.drivers.simulator_server import SimulatorServer
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import RollerRig, Roughness, SensorModel, SimulationSettings

#: Of both sensors, and twice that of the drive.
RATE_HZ = 200.0
_BLOCK_S = 0.01
_STEP_NS = round(1e9 / RATE_HZ)
#: A pause of the machine that is longer is let go of, s: the stamps jump.
_MOST_BEHIND_S = 0.5
#: The limit cycle is followed down by this, m/s.
_STEP_MPS = 0.05
_NOISE = {Channel.LATERAL: 5e-6, Channel.YAW: 2e-5}


def settings(speed_mps: float, quiet: bool = False) -> SimulationSettings:
    """Return the rig at a speed; `quiet`: without forcing, for questions of theory."""
    if quiet:
        return SimulationSettings(RATE_HZ, speed_mps, Roughness(amplitudes=(0.0,)))
    return SimulationSettings(
        RATE_HZ,
        speed_mps,
        Roughness(amplitudes=(20e-6,)),
        8e-6,
        SensorModel(noise=_NOISE[Channel.LATERAL]),
        SensorModel(noise=_NOISE[Channel.YAW]),
    )


def true_limits() -> tuple[float, float]:
    """Return v_n, m/s, and the amplitude above it, m: the limit cycle followed down to its end."""
    rig = RollerRig(paper_rig(), settings(8.0, quiet=True))
    rig.kick(lateral_m=2e-3)
    amplitude, moved = 0.0, math.inf
    while moved > 1e-4:
        rig.advance(round(20.0 * RATE_HZ))
        amplitude, moved = moved, float(np.abs(rig.advance(round(RATE_HZ)).true_lateral).max())
        rig.target_speed -= _STEP_MPS
    return rig.target_speed + 2.0 * _STEP_MPS, amplitude


class Cable:
    """
    What lies between a device and its driver.

    Attributes
    ----------
    state : str
        'well', 'cut' (connections end), 'mute' (they stay, and nothing comes).
    delay_s : float
        Everything comes so much later, both ways.
    """

    def __init__(self) -> None:
        self.state, self.delay_s = 'well', 0.0
        self.under_way: deque[tuple[float, Callable[[], object]]] = deque()

    def carry(self, act: Callable[[], object]) -> None:
        """Deliver now, or when it is due."""
        if self.state == 'well':
            self.under_way.append((time.monotonic() + self.delay_s, act))

    def deliver(self) -> None:
        """Deliver what is due, in its order."""
        while self.under_way and self.under_way[0][0] <= time.monotonic():
            self.under_way.popleft()[1]()


class Rig:
    """The rig, obeying drivers and the director of the scenario."""

    def __init__(self, port: int, seed: int, speed_mps: float) -> None:
        self._rig = RollerRig(paper_rig(), settings(speed_mps), seed)
        self._server = SimulatorServer('127.0.0.1', port)
        self._random = np.random.default_rng(seed)
        self._cables = {channel: Cable() for channel in Channel}
        self._sensors: dict[Channel, tuple[str, float]] = {}
        self._held = {Channel.LATERAL: 0.0, Channel.YAW: 0.0}
        self._drive, self._drive_value = 'well', 1.0
        self._ahead_ns = 0  # of the clock that stamps
        #: Time, s of the epoch; largest displacement of the block, m; true speed; how late it was.
        self.truth: list[tuple[float, float, float, float]] = []
        self.set_points: list[tuple[float, float]] = []

    def obey(self, order: list[object]) -> None:
        """Do what the director says."""
        match order:
            case ['kick', float(size_m)]:
                self._rig.kick(lateral_m=size_m)
            case ['sensor', str(name), str(state), float(value)]:
                self._sensors[Channel[name]] = state, value
            case ['cable', str(name), str(state), float(delay_s)]:
                cable = self._cables[Channel[name]]
                cable.state, cable.delay_s = state, delay_s
            case ['clock', float(step_s)]:
                self._ahead_ns = round(step_s * 1e9)
            case ['drive', str(state), float(value)]:
                self._drive, self._drive_value = state, value
            case _:
                raise ValueError(f'no such order: {order}')

    def _take_set_points(self) -> None:
        told = self._server.poll()
        for client in list(self._server._clients):
            cut = client.channel is not None and self._cables[client.channel].state == 'cut'
            if cut:
                self._server._drop(client)
        if told is not None and self._cables[Channel.DRIVE].state != 'cut':
            self._cables[Channel.DRIVE].carry(lambda: self._obey_set_point(told))

    def _obey_set_point(self, told: float) -> None:
        self.set_points.append((time.time(), told))
        if self._drive != 'deaf' and math.isfinite(told):
            faster = self._drive_value if self._drive == 'faster' else 1.0
            self._rig.target_speed = max(0.0, told) * faster

    def _seen(self, channel: Channel, block: dict[Channel, NDArray[np.float64]]) -> NDArray:
        """Return what a sensor shows."""
        values = block[channel]
        state, value = self._sensors.get(channel, ('well', 0.0))
        if state == 'frozen':
            values = np.full(values.size, self._held[channel])
        elif state == 'nan':
            values = np.full(values.size, math.nan)
        elif state == 'swapped':
            values = block[Channel.YAW if channel is Channel.LATERAL else Channel.LATERAL]
        elif state == 'scaled':
            values = values * value
        elif state == 'noisy':
            values = values + value * _NOISE[channel] * self._random.standard_normal(values.size)
        elif state == 'lost':  # the target of a laser, an open input
            values = _NOISE[channel] * self._random.standard_normal(values.size)
        self._held[channel] = float(values[-1])
        return values

    def _advance(self, count: int, stamps_ns: NDArray[np.int64], late_s: float) -> None:
        block, stamps_ns = self._rig.advance(count), stamps_ns + self._ahead_ns
        seen = {Channel.LATERAL: block.lateral, Channel.YAW: block.yaw}
        for channel in seen:
            values = self._seen(channel, seen)
            self._cables[channel].carry(
                lambda channel=channel, values=values: self._server.send(
                    channel, stamps_ns, values
                )
            )
        told = self._drive_value if self._drive == 'reports' else 1.0
        every = stamps_ns // _STEP_NS % 2 == 0
        if self._drive != 'silent' and every.any():
            rows = stamps_ns[every], block.roller_angle[every] * told, block.speed[every] * told
            self._cables[Channel.DRIVE].carry(lambda: self._server.send(Channel.DRIVE, *rows))
        moved = float(np.abs(block.true_lateral).max())
        self.truth.append((time.time(), moved, self._rig.speed, late_s))

    def run(self) -> None:
        """Run until the director's end of the line is closed."""
        self._rig.advance(0)
        os.set_blocking(sys.stdin.fileno(), False)
        print(json.dumps('ready'), flush=True)
        offset_ns = time.time_ns() - time.monotonic_ns()
        origin_ns = (time.time_ns() // (2 * _STEP_NS) + 1) * 2 * _STEP_NS
        done, text, before_s = 0, b'', time.monotonic()
        while True:
            read = sys.stdin.buffer.raw.read(4096)
            if read == b'':
                return
            *lines, text = (text + (read or b'')).split(b'\n')
            for line in lines:
                self.obey(json.loads(line))
                print(json.dumps('done'), flush=True)
            due = (time.monotonic_ns() + offset_ns - origin_ns) // _STEP_NS - done
            if due * _STEP_NS > _MOST_BEHIND_S * 1e9:
                origin_ns += 2 * (due // 2) * _STEP_NS
                continue
            self._take_set_points()
            if due > 0:
                now_s = time.monotonic()
                late_s, before_s = max(0.0, now_s - before_s - 2.0 * _BLOCK_S), now_s
                stamps_ns = origin_ns + np.arange(done, done + due) * _STEP_NS
                self._advance(int(due), stamps_ns, late_s)
                done += due
            for cable in self._cables.values():
                cable.deliver()
            time.sleep(_BLOCK_S)


def main() -> None:
    """Run a rig, and write what was true."""
    port, seed, speed_mps, path = sys.argv[1:]
    rig = Rig(int(port), int(seed), float(speed_mps))
    try:
        rig.run()
    finally:
        np.savez(Path(path), truth=np.array(rig.truth), set_points=np.array(rig.set_points))


if __name__ == '__main__':
    main()
