"""
The rig's theory and simulation in numbers: speed, accuracy, escapes, swept loops, misfit.

Run with --quick for small samples and no publication.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from tables import markdown, publish

from hunt_ros.compiled import HAVE_COMPILER
from hunt_ros.dynamics.center_manifold import normal_form_of, normal_forms_of
from hunt_ros.dynamics.limit_cycle import Branch, limit_cycles
from hunt_ros.dynamics.model_misfit import fitted_form, misfit
from hunt_ros.dynamics.noise.amplitude_noise import (
    amplitude_diffusion,
    local_form,
    quiet_diffusion,
)
from hunt_ros.dynamics.noise.disturbance import (
    AmplitudeDiffusion,
    Disturbance,
    committor,
    jump_speeds,
    mean_escape_time,
)
from hunt_ros.dynamics.noise.escape_interval import MODEL_ERROR
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import CUBIC_KEYS, QUINTIC_KEYS, RigParameters, paper_rig
from hunt_ros.dynamics.simulation import RollerRig, Roughness, SensorModel, SimulationSettings
from hunt_ros.dynamics.simulation import kernel as simulation_kernel
from hunt_ros.dynamics.wheelset import Wheelset

RIG = paper_rig()
#: Largest error of the integration, nm: a hundredth of the noise of a sensor (5 um).
INTEGRATION_NM = 50
#: Times real time of the whole rig at 500 Hz.
FAST = 2000


def everything(rate: float) -> SimulationSettings:
    """Return settings with every source switched on."""
    return SimulationSettings(
        rate,
        7.2,
        Roughness((50e-6, 10e-6), wheel_amplitudes=(5e-6,)),
        8e-6,
        SensorModel(noise=5e-6, resolution=1e-6, dropouts_per_s=0.1),
        SensorModel(noise=2e-5),
    )


def seconds(work: Callable[[], Any], repeats: int) -> float:
    """Return the median processor time of a call: what it takes of one core."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return float(np.median(times))


def speed_table(quick: bool) -> str:
    """How much faster than real time, beside scipy on the bare wheelset."""
    rows: list[list[object]] = []
    simulated = 60.0 if quick else 600.0
    for rate in (100.0, 500.0, 1000.0, 2000.0):
        stream = RollerRig(RIG, everything(rate), 1)
        stream.advance(10)
        count = int(simulated * rate)
        taken = seconds(lambda n=count, s=stream: s.advance(n), 5)  # type: ignore[misc]
        goal = FAST if rate == 500.0 else 1
        rows.append([f'RollerRig, everything on, {rate:.0f} Hz', simulated / taken, goal, '-'])
    stream = RollerRig(RIG, everything(500.0), 1)
    for size in (1, 2, 4):
        taken = seconds(lambda n=size: stream.advance(n), 5000)  # type: ignore[misc]
        rows.append([f'advance({size}) at 500 Hz', size / 500.0 / taken, 1, 1e6 * taken])
    wheelset, scale = Wheelset(RIG), RIG.time_scale
    start, grid = [6e-3, 0.0, 0.0, 0.0], np.arange(0, 10.0, 2e-3) / scale
    for method in ('RK45', 'LSODA'):
        taken = seconds(
            lambda m=method: solve_ivp(  # type: ignore[misc]
                lambda t, x: wheelset.derivative(x, 7.2),
                (0.0, grid[-1]),
                start,
                method=m,
                t_eval=grid,
                rtol=1e-7,
                atol=1e-11,
            ),
            3,
        )
        rows.append([f'scipy {method}, wheelset alone, rtol 1e-7', 10.0 / taken, 'peer', '-'])
    if HAVE_COMPILER:
        stream = RollerRig(RIG, everything(500.0), 1)
        compiled, simulation_kernel.advance = simulation_kernel.advance, plain_kernel()
        taken = seconds(lambda: stream.advance(500), 3)
        simulation_kernel.advance = compiled
        rows.append(['RollerRig in plain Python (outer loop)', 1.0 / taken, 1, '-'])
    return markdown(['what', 'times real time', 'at least', 'microseconds a call'], rows)


def plain_kernel() -> Any:
    """Return the outer loop uncompiled; the functions it calls stay compiled."""
    return simulation_kernel.advance.py_func  # type: ignore[attr-defined]


def accuracy() -> str:
    """Differences from a strict integrator after half a minute near the limit cycle."""
    rig = RollerRig(RIG, SimulationSettings(500.0, 8.8))
    rig.kick(3e-4)
    ours = rig.advance(15_001).true_lateral
    wheelset = Wheelset(RIG)
    times = np.arange(15_001) / 500.0

    def run(method: str, rtol: float, atol: float) -> Any:
        return solve_ivp(
            lambda t, x: wheelset.derivative(x, 8.8),
            (0, times[-1] / RIG.time_scale),
            [3e-4 / RIG.length_scale, 0, 0, 0],
            method=method,
            t_eval=times / RIG.time_scale,
            rtol=rtol,
            atol=atol,
        ).y[0]

    truth = run('DOP853', 1e-11, 1e-15)
    paths = {'RollerRig': ours / RIG.length_scale}
    for method in ('RK45', 'LSODA'):
        paths[f'scipy {method}, rtol 1e-7'] = run(method, 1e-7, 1e-11)
    rows = [
        [name, 1e9 * RIG.length_scale * float(np.abs(path - truth).max()), INTEGRATION_NM]
        for name, path in paths.items()
    ]
    return markdown(['integrator', 'largest error, nm', 'bound, nm'], rows)


def escapes(branch: Branch, fitted: NormalForm, quick: bool) -> tuple[str, tuple[float, float]]:
    """Mean escape times of the full model against the one-dimensional equation."""
    cases = ((7.2, 5e-5), (7.2, 6e-5), (7.2, 7e-5), (7.2, 9e-5), (7.6, 3e-5), (6.8, 1.2e-4))
    count = 30 if quick else 400
    theory = normal_form_of(RIG)
    rows, ratios = [], []
    for speed, broadband in cases:
        form = local_form(theory, branch, speed)
        law = amplitude_diffusion(RIG, speed, broadband, branch)
        unstable = float(form.unstable_amplitude(speed))
        quiet = math.sqrt(2 * law.quiet / -float(form.growth_rate(speed)))
        roof = 0.5 * sum(float(x) for x in branch.at_speed(speed).amplitude)
        times = np.array([escape(speed, broadband, roof, seed) for seed in range(count)])
        mean, error = times.mean(), times.std() / math.sqrt(count)
        local = float(mean_escape_time(form, speed, law))
        whole = float(mean_escape_time(fitted, speed, law))
        flat = float(mean_escape_time(form, speed, law.quiet))
        inside = abs(math.log(local / mean)) < 1.96 * MODEL_ERROR
        ratios.append(local / mean)
        rows.append(
            [
                speed,
                broadband,
                quiet / unstable,
                f'{mean:.4g} +/- {error:.2g}',
                local,
                local / mean,
                100 * (math.log(local) / math.log(mean) - 1),
                'yes' if inside else 'no',
                whole / mean,
                flat / mean,
            ]
        )
    header = ['v m/s', 'wn', 'A_rms/A_u', f'simulated s ({count})', 'theory s', 'ratio']
    header += ['log error %', 'in 95 % interval', 'ratio, fitted form', 'ratio, constant D']
    return markdown(header, rows), (min(ratios), max(ratios))


def escape(speed: float, broadband: float, roof: float, seed: int) -> float:
    """Time until one simulated rig is beyond the roof, s."""
    rig = RollerRig(RIG, SimulationSettings(initial_speed=speed, broadband=broadband), seed)
    while np.abs(rig.advance(500).true_lateral).max() < roof:
        pass
    return rig.time_s - 0.5


def sweeps(fitted: NormalForm, quick: bool) -> str:
    """Apparent critical speeds of swept rigs against the swept Fokker-Planck equation."""
    fold = fitted.saddle_node()
    assert fold is not None
    up, down = 0.5 * float(fitted.stable_amplitude(8.0)), 0.5 * fold[1]
    count = 10 if quick else 100
    rows = []
    for broadband, rate in ((8e-6, 0.005), (8e-6, 0.02), (8e-6, 0.05), (2e-5, 0.02), (3e-5, 0.02)):
        law = AmplitudeDiffusion(quiet_diffusion(RIG, 7.2, broadband))
        disturbance = Disturbance(law, 0.0, rate)
        row: list[object] = [broadband, rate]
        for direction, threshold in (('up', up), ('down', down)):
            seen = [jump(broadband, rate, direction, threshold, seed) for seed in range(count)]
            predicted = jump_speeds(fitted, disturbance, direction)  # type: ignore[arg-type]
            row += [f'{np.median(seen):.3f} ({np.std(seen):.3f})']
            row += [f'{predicted.median:.3f} ({predicted.std:.3f})']
        rows.append(row)
    header = ['wn', 'rate m/s^2', f'v_c simulated ({count})', 'v_c theory']
    return markdown([*header, 'v_n simulated', 'v_n theory'], rows)


def jump(broadband: float, rate: float, direction: str, threshold: float, seed: int) -> float:
    """Speed at which one swept rig jumps, m/s."""
    up = direction == 'up'
    start = 6.9 if up else 6.8
    rig = RollerRig(RIG, SimulationSettings(initial_speed=start, broadband=broadband), seed)
    if not up:
        rig.kick(6e-4)
        rig.advance(2500)
    begin = rig.time_s
    while True:
        times = rig.time_s - begin + np.arange(88) / 500.0  # half a period of hunting
        block = rig.advance(88, start + (rate if up else -rate) * times)
        peak = np.abs(block.true_lateral).max()
        if (peak > threshold) == up or not 5.0 < rig.speed < 12.0:
            return float(block.speed[-1])


def costs() -> str:
    """What one call costs, beside what its caller can wait."""
    rng = np.random.default_rng(0)
    rigs = [
        RigParameters(
            alpha={k: float(rng.normal(0, 50)) for k in CUBIC_KEYS + QUINTIC_KEYS},
            beta={k: float(rng.normal(0, 50)) for k in CUBIC_KEYS + QUINTIC_KEYS},
            tread_angle=0.1,
        ).with_linear(*rng.uniform(1.4, 2.6, 2))
        for _ in range(1000)
    ]
    amplitudes = np.linspace(0.0, 6e-4, 100)
    rows = [
        [
            'normal forms of 1000 rigs, 40 nonlinear terms each',
            seconds(lambda: normal_forms_of(rigs), 3),
            1,
        ],
        [
            'limit cycles of the default rig through the fold',
            seconds(lambda: limit_cycles(RIG), 3),
            1,
        ],
        [
            'committor at 100 amplitudes',
            seconds(lambda: committor(PAPER_NORMAL_FORM, 7.2, amplitudes, 1e-9), 200),
            0.01,
        ],
        [
            'mean escape time from 100 amplitudes',
            seconds(lambda: mean_escape_time(PAPER_NORMAL_FORM, 7.2, 1e-9, amplitudes), 200),
            0.01,
        ],
    ]
    return markdown(['call', 'measured', 'bound'], rows)


def misfits(branch: Branch, fitted: NormalForm) -> str:
    """How far the quintic form is from the full model."""
    taylor = normal_form_of(RIG).amplitude_coordinate
    rows = []
    for name, form in (('at the Hopf point', taylor), ('fitted to the branch', fitted)):
        m = misfit(form, branch, (6.6, 9.0))
        rows.append([name, m.nonlinear_critical_speed, 100 * m.unstable, 100 * m.stable])
    return markdown(
        ['quintic form', 'v_n error m/s', 'unstable branch %', 'stable branch %'], rows
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true')
    quick = parser.parse_args().quick
    branch = limit_cycles(RIG)
    fitted = fitted_form(normal_form_of(RIG), branch, (6.4, 9.0))
    table, (low, high) = escapes(branch, fitted, quick)
    parts = [
        'Time domain, roughness of roller and wheel, forcing, drop-outs and quantisation on'
        f' (goal: {FAST} times real time at 500 Hz; a live rig needs 1):',
        speed_table(quick),
        'Largest difference from DOP853 (rtol 1e-11) in 30 s near the limit cycle at 8.8 m/s;'
        ' the bound is a hundredth of the noise of a sensor:',
        accuracy(),
        'Calls, in seconds of one core. A row of the detector may need a new committor and'
        ' escape time: the bound is its period at 100 Hz. A command waits for the others:',
        costs(),
        'Full model against the quintic form, 6.6 to 9.0 m/s:',
        misfits(branch, fitted),
        'Escapes of the full model from rest against the Fokker-Planck equation of the amplitude'
        ' (goal: within a factor 1.7, and 10 % in the logarithm). The theory has the growth'
        ' rate, unstable amplitude and exponent of the full model at that speed and a diffusion'
        ' from its Floquet vectors; the last columns leave one of the two out. Ratios lie'
        f' between {low:.2f} and {high:.2f}.',
        table,
        'Swept rigs against the swept Fokker-Planck equation, median and (standard deviation),'
        ' m/s; the fitted form has its fold 0.013 m/s below that of the full model:',
        sweeps(fitted, quick),
    ]
    text = '\n\n'.join(parts)
    if quick:
        print(text)
    else:
        publish('bench-simulation', 'Dynamics: simulation, theory, disturbances', text)


if __name__ == '__main__':
    main()
