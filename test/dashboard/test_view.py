"""A viewer that is sent differences shows what one that came later shows."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.dashboard.view import Rows, Section, View, changes


class Page:
    """What the script of the page does with a message."""

    def __init__(self) -> None:
        self.sections: dict = {}
        self.streams: dict = {}

    def apply(self, message: dict) -> None:
        message = json.loads(json.dumps(message))
        self.sections |= message['sections']
        for name, change in message['streams'].items():
            if change['fresh'] or name not in self.streams:
                self.streams[name] = [change['first'], []]
            first, rows = self.streams[name]
            rows += change['rows']
            self.streams[name] = [change['keep'], rows[change['keep'] - first :]]


#: What happens to the model between two looks of a viewer: rows, or a new beginning.
STEPS = st.lists(
    st.tuples(st.sampled_from(['append', 'replace', 'look']), st.integers(0, 7)), max_size=40
)


@given(STEPS, st.integers(1, 9))
def test_differences_taken_at_any_moments_add_up_to_the_whole(steps, most) -> None:
    rows, page, has = Rows(most), Page(), View()
    number = 0
    for what, count in [*steps, ('look', 0)]:
        new = [(number + k,) for k in range(count)]
        number += count
        if what == 'append':
            rows.append(new)
        elif what == 'replace':
            rows.replace(new)
        else:
            view = View({'n': Section(number, number)}, {'rows': rows.stream})
            page.apply(changes(has, view))
            has = view
            late = Page()
            late.apply(changes(View(), view))
            assert page.streams == late.streams
            assert page.sections == late.sections
    assert len(rows) <= most


def test_what_has_not_changed_is_not_sent() -> None:
    rows = Rows(3)
    rows.append([(1,)])
    view = View({'status': Section(1, 'OK')}, {'rows': rows.stream})
    assert changes(view, view) == {'sections': {}, 'streams': {}}
