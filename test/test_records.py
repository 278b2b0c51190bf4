"""Records: the same fields for compiled kernels and for plain Python."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pytest
from numpy.typing import NDArray

from hunt_ros.compiled import compiled
from hunt_ros.records import zeros


class Point:
    """A part of a record."""

    x: float
    seen: bool


class Path:
    """A record with everything that a record may hold."""

    count: int
    end: Point
    points: Annotated[list[Point], 3]
    table: Annotated[NDArray[np.float64], 2, 4]


def _fill(path: Path) -> None:
    path.count += 2
    path.end.x = 1.5
    for k in range(len(path.points)):
        path.points[k].seen = path.points[k].x == 0.0
        path.points[k].x = path.end.x + k
    path.table[1, 3] = path.points[2].x


@pytest.mark.parametrize('fill', [_fill, compiled(_fill)], ids=['plain', 'compiled'])
@pytest.mark.parametrize('memory', [True, False], ids=['memory', 'objects'])
def test_a_record_is_written_by_name(fill, memory) -> None:
    if fill is not _fill and not memory:
        pytest.skip('a kernel works on memory')
    path = zeros(Path, memory)
    assert path.count == 0
    assert not path.points[1].seen
    assert not path.table.any()
    fill(path)
    assert path.count == 2
    assert path.end.x == 1.5
    assert [point.x for point in path.points] == [1.5, 2.5, 3.5]
    assert all(point.seen for point in path.points)
    assert path.table.tolist() == [[0.0] * 4, [0.0, 0.0, 0.0, 3.5]]


@pytest.mark.parametrize('memory', [True, False], ids=['memory', 'objects'])
def test_a_record_that_is_set_is_a_copy(memory) -> None:
    """A kernel keeps what it has a name for, and the name what it has."""
    path = zeros(Path, memory)
    first, second = path.points[0], path.points[1]
    first.x = 4.0
    path.points[1] = path.points[0]
    first.x = 5.0
    assert [point.x for point in path.points] == [5.0, 4.0, 0.0]
    assert second.x == 4.0


class Taken:
    """A record with a name that every record of numpy has."""

    size: int


def test_a_name_that_numpy_reads_in_another_way_is_refused() -> None:
    with pytest.raises(TypeError, match=r'Taken\.size'):
        zeros(Taken, True)
