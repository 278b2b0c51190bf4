"""Identifications of a known rig, and what a page may hold."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
from made import LAW

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds, SteadyState
from hunt_ros.dynamics.growth_law import TERMS, lawful
from hunt_ros.dynamics.identified import PARAMETERS, IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.identification.four_point import FourPoint
from hunt_ros.identification.posterior import BranchPoint, Posterior
from hunt_ros.identification.result import FitSummary, Identification
from hunt_ros.identification.verdict.reasons import unknown_of
from hunt_ros.samples import Uncertain

#: Standard deviations of (v_c, D1, D4, D7, D10, D15) as a staircase gives them.
_STD = np.array([0.04, 0.0016, 24.0, 0.011, 75.0, 5.2e5])


def identified_form(form: NormalForm = PAPER_NORMAL_FORM) -> IdentifiedNormalForm:
    """Return a form with a covariance in which D4 and D15 hang together."""
    correlation = np.eye(6)
    correlation[2, 5] = correlation[5, 2] = -0.95
    covariance = correlation * np.outer(_STD, _STD)
    return IdentifiedNormalForm(form, covariance, {'recordings': 'run_a.mcap'})


def identification_of(form: NormalForm = PAPER_NORMAL_FORM, **more: Any) -> Identification:
    """Return an identification of that form with measured points; `more`: other fields."""
    one = identified_form(form)
    random = np.random.default_rng(1)
    v_n, v_c = form.nonlinear_critical_speed, form.critical_speed
    low = v_c - 2.0
    states = []
    for direction in ('up', 'down'):
        hunts_from = v_c - 0.3 if direction == 'up' or v_n is None else v_n
        for speed in low + 0.2 * np.arange(15):
            amplitude = float(form.stable_amplitude(speed))
            hunting = speed >= hunts_from and np.isfinite(amplitude)
            true = amplitude if hunting else 2.2e-5 + 1e-5 * (speed - low)
            measured = float(true * (1.0 + 0.01 * random.standard_normal()))
            states.append(SteadyState(float(speed), measured, 0.012 * true, direction, 62))
    branches = []
    for speed in np.linspace(low, v_c + 0.8, 29):
        ends = [float(x) for x in form.steady_amplitudes(speed)]
        unstable, stable = (Uncertain(x, 0.02 * x) if np.isfinite(x) else None for x in ends)
        branches.append(BranchPoint(float(speed), stable, unstable))
    fit = FitSummary('quintic', 31, 4.6e-6, False, (), 0.4, 212.0, True)
    found = Identification(
        normal_form=one,
        v_c=Uncertain(v_c, one.std('v_c')),
        v_n=None if v_n is None else Uncertain(v_n, 0.03),
        hysteresis_width=None if v_n is None else Uncertain(v_c - v_n, 0.05),
        coefficients={
            name: Uncertain(getattr(form, name), one.std(name)) for name in PARAMETERS[1:]
        },
        criticality=form.criticality,
        length_scale=form.length_scale,
        time_scale=form.time_scale,
        scales_from={'length': 'rig of the paper', 'time': 'given'},
        speeds=(low, v_c + 0.8),
        branches=branches,
        steady_states=states,
        observed=ObservedCriticalSpeeds(v_c - 0.3, None if v_n is None else v_n + 0.1, 0.2),
        disturbance=Uncertain(1.48e-4, 0.9e-5),
        four_point=FourPoint(1988.2, -0.051, -410.4, -4.13e7, 3.1e4),
        fit=fit,
        frequency_hz=Uncertain(2.84, 0.01),
        notices=['v_n: the last hunting plateau and the first quiet one are 0.2 m/s apart'],
    )
    found = replace(found, **more)
    return replace(found, unknown=unknown_of(found.to_json(), {}) | dict(more.get('unknown', {})))


def identification_of_the_paper(seed: int = 1) -> Identification:
    """Return what draws know of the paper's form: v_n to 0.03 m/s and v_c to 0.1 m/s, no fit."""
    rng = np.random.default_rng(seed)
    vague = lawful([0.03, 0.03, 0.1, 0.02, 0.05, 0.02], felt=0.0)
    p = LAW.p + np.abs(LAW.p) * vague * rng.standard_normal((400, TERMS))
    intensity = 5e-12 * np.exp(0.2 * rng.standard_normal(400))
    posterior = Posterior(LAW, p, intensity, (6.0, 8.8))
    drawn = posterior.numbers(0.0)
    return identification_of(
        normal_form=posterior.identified(0.0),
        posterior=posterior,
        branches=posterior.branch_points(),
        speeds=posterior.speeds,
        steady_states=(),
        disturbance=None,
        four_point=None,
        **{name: drawn[name] for name in ('v_c', 'v_n', 'hysteresis_width')},
    )


VOID = {'meta', 'link', 'br', 'wbr', 'img', 'hr', 'input'}


class Outline(HTMLParser):
    """
    Checks that every element is closed, and collects what a browser would fetch or run.

    `values` are those of the `data` elements.
    """

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.handlers: list[str] = []
        self.identifiers: list[str] = []
        self.scripts: list[str | None] = []
        self.values: set[float] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ('src', 'href', 'xlink:href', 'data', 'action', 'poster', 'srcset'):
                self.addresses.append(value or '')
            if name.startswith('on'):
                self.handlers.append(name)
            if name == 'id':
                self.identifiers.append(value or '')
        if tag == 'data':
            self.values.add(float(dict(attrs)['value'] or ''))
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


def assert_self_contained(page: str) -> Outline:
    """Nothing is loaded from anywhere, nothing runs."""
    parsed = Outline()
    parsed.feed(page)
    parsed.close()
    assert parsed.open == []
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
