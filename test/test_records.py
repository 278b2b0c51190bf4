"""Records: to set one copies it, in memory as in plain Python; kernels and objects do the same."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pytest
from numpy.typing import NDArray

from hunt_ros.records import zeros


class Point:
    """A part of a record."""

    x: float


class Path:
    """A record with everything that a record may hold."""

    count: int
    end: Point
    points: Annotated[list[Point], 3]
    table: Annotated[NDArray[np.float64], 2, 4]


class Paths:
    """Where records are set."""

    each: Annotated[list[Path], 2]


def contents(path: Path) -> list[float]:
    return [path.count, path.end.x, *(point.x for point in path.points), *path.table.ravel()]


@pytest.mark.parametrize('memory', [True, False], ids=['memory', 'objects'])
def test_a_record_that_is_set_is_a_copy(memory) -> None:
    """A kernel keeps what it has a name for, and the name what it has."""
    paths = zeros(Paths, memory)
    first, second = paths.each[0], paths.each[1]
    assert contents(first) == [0.0] * 13
    for value in (2, 3):
        first.count, first.end.x, first.points[1].x, first.table[1, 3] = [value] * 4
        if value == 2:
            paths.each[1] = first
    assert contents(first) == [3, 3, 0, 3, 0, *[0] * 7, 3]
    assert contents(second) == [2, 2, 0, 2, 0, *[0] * 7, 2]


class Taken:
    """A record with a name that every record of numpy has."""

    size: int


def test_a_name_that_numpy_reads_in_another_way_is_refused() -> None:
    with pytest.raises(TypeError, match=r'Taken\.size'):
        zeros(Taken, True)
