"""A seed means the same draws whatever linear algebra library finds the eigenvectors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.dynamics.covariance_root import covariance_root
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM


@pytest.fixture
def another_library(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Call it, and eigenvectors have the other sign from then on, as right as before."""
    eigh = np.linalg.eigh

    def turned(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = eigh(matrix)
        return values, -vectors

    return lambda: monkeypatch.setattr(np.linalg, 'eigh', turned)


@given(
    logarithms=st.lists(st.floats(-9.0, 1.0), min_size=2, max_size=6),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_root_is_symmetric_in_the_correlations_and_squares_to_the_covariance(
    logarithms, seed
) -> None:
    std = 10.0 ** np.array(logarithms)
    mix = np.random.default_rng(seed).normal(size=(std.size, std.size + 2))
    covariance = mix @ mix.T * np.outer(std, std)
    root = covariance_root(covariance)
    within = 1e-9 * np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert (np.abs(root @ root.T - covariance) <= within).all()
    scaled = root / np.sqrt(np.diag(covariance))[:, None]
    assert scaled == pytest.approx(scaled.T, abs=1e-9)


def test_what_does_not_vary_is_not_drawn() -> None:
    covariance = np.diag([4.0, 0.0, 1e-20])
    assert covariance_root(covariance) == pytest.approx(np.diag([2.0, 0.0, 1e-10]), rel=1e-12)


def test_an_identified_form_gives_the_same_draws(another_library) -> None:
    mix = np.random.default_rng(1).normal(size=(6, 9)) * 1e-3
    form = IdentifiedNormalForm(PAPER_NORMAL_FORM, mix @ mix.T)
    here = [IdentifiedNormalForm(one).vector for one in form.draws(5)]
    another_library()
    there = [IdentifiedNormalForm(one).vector for one in form.draws(5)]
    assert np.array(there) == pytest.approx(np.array(here), rel=1e-9)
