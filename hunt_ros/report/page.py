"""
The page: one HTML file that needs nothing but itself.

No script, no font, no picture and no style sheet from anywhere: a content security
policy in the head forbids it, so that a report opened in ten years, or on a rig
without network, looks as it did. Colours follow the reader's light or dark scheme;
on paper they are always the light ones.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, TypeAlias

from hunt_ros.report.figures.style import palette_css

#: A section of the page: anchor (letters and hyphens), title (plain text), body (HTML).
Section: TypeAlias = tuple[str, str, str]

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"

_CSS = """
:root { color-scheme: light dark; LIGHT }
@media (prefers-color-scheme: dark) { :root { DARK } }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.5 system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.2rem; margin: 2.6rem 0 .6rem; padding-top: .6rem;
  border-top: 1px solid var(--grid); }
p, li { max-width: 46rem; overflow-wrap: anywhere; }
nav ol { display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; margin: 1rem 0; padding: 0;
  list-style: none; font-size: .9rem; }
a { color: var(--stable); }
.lead { font-size: 1.05rem; }
.muted, figcaption { color: var(--muted); font-size: .88rem; }
figure { margin: 1.2rem 0; break-inside: avoid; }
figure svg { display: block; width: 100%; height: auto; }
figure.column { max-width: 34rem; }
.drawing { overflow-x: auto; }
@media screen { figure.page svg { min-width: 34rem; } }
figcaption { margin-top: .4rem; max-width: 46rem; overflow-wrap: anywhere; }
figcaption b { color: var(--ink); }
.grid { display: grid; gap: 1rem 1.6rem;
  grid-template-columns: repeat(auto-fit, minmax(min(22rem, 100%), 1fr)); }
.grid figure { margin: 0; min-width: 0; max-width: 34rem; }
.wide { overflow-x: auto; }
figure.table { break-inside: auto; }
.table figcaption { margin: 0 0 .4rem; break-after: avoid; }
.path, .text { display: block; min-width: 14rem; overflow-wrap: anywhere; }
table { min-width: min(26rem, 100%); border-collapse: collapse; font-size: .88rem;
  font-variant-numeric: tabular-nums; }
thead th { border-bottom: 1.5px solid var(--ink); vertical-align: bottom; }
th, td { text-align: left; padding: .28rem .9rem .28rem 0; vertical-align: top; }
tbody th { font-weight: normal; }
tbody tr { border-bottom: 1px solid var(--grid); break-inside: avoid; }
td data, .together { white-space: nowrap; }
.unknown { color: var(--unstable); font-style: italic; }
.level-WARN, .level-ERROR, .level-STALE { font-weight: 600; }
.warnings li { border-left: 3px solid var(--unstable); padding-left: .7rem; margin: .5rem 0; }
ul.warnings, ul.unknowns { list-style: none; padding: 0; }
ul.unknowns li { margin: .6rem 0; }
.equation { font-size: 1.05rem; overflow-x: auto; white-space: nowrap; }
pre { overflow-x: auto; font-size: .8rem; padding: .8rem; border: 1px solid var(--grid); }
code { font-size: .9em; }
details summary { cursor: pointer; color: var(--stable); }
@media print {
  :root { color-scheme: light; LIGHT }
  @page { size: A4; margin: 18mm; }
  body { font-size: 10pt; }
  main { max-width: none; padding: 0; }
  nav { display: none; }
  h2 { break-after: avoid; }
  figure.column { max-width: 110mm; }
  .grid { grid-template-columns: 1fr 1fr; }
  .wide, .drawing, pre { overflow: visible; }
  table { font-size: 8pt; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; }
}
"""


def render(title: str, lead: str, sections: Sequence[Section], document: Mapping[str, Any]) -> str:
    """
    Return the whole page.

    Parameters
    ----------
    title : str
        Plain text.
    lead : str
        HTML: the result in a sentence or two.
    sections : sequence of Section
        In their order.
    document : mapping
        The JSON of the identification, which stays in the page as data, so that the
        numbers can be taken from it unrounded.
    """
    css = _CSS.replace('LIGHT', palette_css(False)).replace('DARK', palette_css(True))
    contents = ''.join(
        f'<li><a href="#{anchor}">{escape(name)}</a></li>' for anchor, name, _ in sections
    )
    body = '\n'.join(
        f'<section id="{anchor}"><h2>{escape(name)}</h2>\n{text}</section>'
        for anchor, name, text in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{escape(title)}</title>\n<style>{css}</style>\n</head>\n<body>\n<main>\n'
        f'<h1>{escape(title)}</h1>\n<div class="lead">{lead}</div>\n'
        f'<nav aria-label="Contents"><ol>{contents}</ol></nav>\n{body}\n</main>\n'
        '<script type="application/json" id="identification">'
        f'{_json_in_html(document)}</script>\n</body>\n</html>\n'
    )


def figure(drawing: str, number: str, caption: str, wide: bool = False) -> str:
    """
    Return a figure with its caption.

    Parameters
    ----------
    drawing : str
        An SVG element.
    number : str
        'Fig. 6', as the paper counts; '' without a number.
    caption : str
        HTML.
    wide : bool
        Over the whole width of the page instead of a column.
    """
    kind = 'page' if wide else 'column'
    head = f'<b>{escape(number)}</b> ' if number else ''
    drawing = f'<div class="drawing">{drawing}</div>'
    return f'<figure class="{kind}">{drawing}<figcaption>{head}{caption}</figcaption></figure>'


def _json_in_html(document: Mapping[str, Any]) -> str:
    """Return the JSON so that no text in it can end the element it stands in."""
    text = json.dumps(document, allow_nan=False, default=lambda value: value.tolist())
    return text.replace('<', '\\u003c').replace('>', '\\u003e').replace('&', '\\u0026')
