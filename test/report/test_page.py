"""The page needs nothing but itself, whatever is written into it."""

from __future__ import annotations

import json
import re
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from report_made import assert_self_contained

from hunt_ros.report.page import figure, render


def a_page(document: dict[str, Any], title: str = 'A run', text: str = '') -> str:
    drawing = figure('<svg role="img"></svg>', 'Fig. 6', 'A <b>loop</b>.')
    return render(title, '<p>Lead.</p>', [('loop', f'Loop {text}', drawing)], document)


def test_it_is_a_page_for_phone_paper_light_and_dark() -> None:
    page = a_page({})
    assert page.startswith('<!DOCTYPE html>')
    assert '<html lang="en">' in page
    assert 'width=device-width' in page
    assert 'prefers-color-scheme: dark' in page
    assert '@media print' in page
    for part in ('charset', '<title>A run</title>'):
        assert part in page


def embedded(page: str) -> Any:
    found = re.search(r'<script type="application/json" id="[a-z]+">(.*?)</script>', page, re.S)
    assert found
    return json.loads(found.group(1))


@given(st.text(), st.text())
def test_no_text_can_break_out_of_the_page(text: str, title: str) -> None:
    nasty = f'</script></style><script src="http://x">{text}'
    document = {'v_c': {'value': 0.1 + 0.2}, 'v_n': None, 'warnings': [nasty, text]}
    page = a_page(document, title + nasty, nasty)
    parsed = assert_self_contained(page)
    assert parsed.scripts == ['application/json']
    assert embedded(page) == document, 'to the last bit'
