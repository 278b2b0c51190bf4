"""Thousands of damaged recordings: each ends in a result or a BagError, in bounded memory."""

from __future__ import annotations

from pathlib import Path

import pytest
from made import python


@pytest.mark.slow
def test_every_damaged_recording_ends_in_a_result_or_a_bag_error() -> None:
    program = Path(__file__).with_name('fuzz_bags.py')
    run = python(program, '--cases', '2000', '--seed', '1')
    assert run.stdout.splitlines()[-1] == '2000 cases ended as they should, 0 did not'
