"""`hunt compile`: make the machine code of every kernel once, so that no first run waits."""

from __future__ import annotations

import argparse
import time
from contextlib import suppress

SUMMARY = 'compile the kernels once, so that no first run waits (make install does it)'
EXAMPLE = 'hunt compile'


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options: none."""


def run(arguments: argparse.Namespace) -> int:
    """
    Simulate a sweep, run it through the detector and identify it.

    A kernel is compiled for the types that it meets, so the surest way to meet them
    all is to do what is done with it.
    """
    from hunt_ros.compiled import HAVE_COMPILER

    if not HAVE_COMPILER:
        print('numba is not installed: the kernels run as plain Python, nothing to compile')
        return 0
    from hunt_ros.detection import DetectorConfig, HuntingDetector
    from hunt_ros.detection.offline import detect
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
    from hunt_ros.dynamics.parameters import paper_rig
    from hunt_ros.dynamics.simulation import Roughness, SimulationSettings, SpeedProfile, simulate
    from hunt_ros.errors import HuntError
    from hunt_ros.identification import identify
    from hunt_ros.identification.plan import PlanSettings, plan

    began = time.monotonic()
    settings = SimulationSettings(
        sample_rate_hz=100.0, initial_speed=6.0, roughness=Roughness((2e-5,)), broadband=8e-6
    )
    profile = SpeedProfile((0.0, 100.0, 200.0), (6.0, 8.8, 6.0))
    record = simulate(paper_rig(), settings, profile, seed=1)
    for form in (None, IdentifiedNormalForm(PAPER_NORMAL_FORM)):
        detect(HuntingDetector(DetectorConfig(), form), record)
    with suppress(HuntError):  # whatever it finds, it has run
        plan(identify([record]), PlanSettings(budget_s=60.0))
    print(f'the kernels are compiled ({time.monotonic() - began:.0f} s)')
    return 0
