"""Ten thousand damaged recordings: each ends in a result or a BagError, in bounded memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_every_damaged_recording_ends_in_a_result_or_a_bag_error() -> None:
    program = Path(__file__).with_name('fuzz_bags.py')
    run = subprocess.run(
        [sys.executable, str(program), '--cases', '4000', '--seed', '1'],
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout[-4000:] + run.stderr[-2000:]
    assert run.stdout.splitlines()[-1] == '4000 cases ended as they should, 0 did not'
