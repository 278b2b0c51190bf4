"""What a person says with a call."""

from __future__ import annotations

import pytest

from hunt_ros.services import spoken


@pytest.mark.parametrize(
    ('said', 'shown'),
    [
        ('  Mia \n Meier ', 'Mia Meier'),
        ('\u202elive yb', 'live yb'),
        ('a\x1b[2Jb\x00', 'a [2Jb'),
        ('\ud800', ''),
        ('Zoë 张伟 مها', 'Zoë 张伟 مها'),
        ('x' * 500, 'x' * 200),
    ],
)
def test_words_are_one_line_that_shows_what_it_holds(said, shown) -> None:
    assert spoken(said) == shown
    spoken(said).encode()
