"""The page needs nothing but itself, whatever is written into it."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.report.page import figure, render

DOCUMENT = {'v_c': {'value': 0.1 + 0.2, 'std': 1e-17}, 'v_n': None, 'warnings': ['a < b']}

VOID = {'meta', 'br', 'img', 'link', 'input', 'hr'}


class Outline(HTMLParser):
    """Checks that every element is closed, and collects what a browser would fetch or run."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.handlers: list[str] = []
        self.identifiers: list[str] = []
        self.scripts: list[str | None] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ('src', 'href', 'xlink:href', 'data', 'action', 'poster', 'srcset'):
                self.addresses.append(value or '')
            if name.startswith('on'):
                self.handlers.append(name)
            if name == 'id':
                self.identifiers.append(value or '')
        if tag == 'script':
            self.scripts.append(dict(attrs).get('type'))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f'</{tag}> closes nothing'
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def outline(page: str) -> Outline:
    parser = Outline()
    parser.feed(page)
    parser.close()
    assert parser.open == []
    return parser


def assert_self_contained(page: str) -> Outline:
    """Nothing is loaded from anywhere, nothing runs."""
    parsed = outline(page)
    assert all(address.startswith('#') for address in parsed.addresses), parsed.addresses
    assert parsed.handlers == []
    assert set(parsed.scripts) <= {'application/json'}
    style = ''.join(re.findall(r'<style>(.*?)</style>', page, re.DOTALL))
    assert 'url(' not in style
    assert '@import' not in style
    assert "default-src 'none'" in page
    assert len(parsed.identifiers) == len(set(parsed.identifiers))
    targets = [address[1:] for address in parsed.addresses]
    assert set(targets) <= set(parsed.identifiers)
    return parsed


def a_page(document: dict[str, Any], title: str = 'A run', text: str = '') -> str:
    drawing = figure('<svg role="img"></svg>', 'Fig. 6', 'A <b>loop</b>.')
    return render(title, '<p>Lead.</p>', [('loop', f'Loop {text}', drawing)], document)


def test_the_page_needs_nothing_but_itself() -> None:
    parsed = assert_self_contained(a_page(DOCUMENT))
    assert parsed.scripts == ['application/json']


def test_it_is_a_page_for_phone_paper_light_and_dark() -> None:
    page = a_page(DOCUMENT)
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


def test_the_document_stands_in_the_page_to_the_last_bit() -> None:
    assert embedded(a_page(DOCUMENT)) == DOCUMENT


@given(st.text(), st.text())
def test_no_text_can_break_out_of_the_page(text: str, title: str) -> None:
    nasty = f'</script></style><script src="http://x">{text}'
    page = a_page({'warnings': [nasty, text]}, title + nasty, nasty)
    parsed = assert_self_contained(page)
    assert parsed.scripts == ['application/json']
    assert embedded(page)['warnings'] == [nasty, text]
