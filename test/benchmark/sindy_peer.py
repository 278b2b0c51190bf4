"""The peer of the identification benchmark: pysindy on the amplitudes of trajectories."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from scipy.signal import butter, hilbert, sosfiltfilt

from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.samples import Record


def radii(records: Sequence[Record]) -> tuple[list[np.ndarray], float]:
    """Envelopes for the peer: band-pass, Hilbert, 1.5 s trimmed at each end, at 50 Hz.

    Band, rate and the windows of the weak form are those that served the peer best of
    half a dozen that were tried.
    """
    band = butter(4, [2.2, 3.5], 'bandpass', fs=100.0, output='sos')
    paths = []
    for record in records:
        lateral = record['lateral'].values
        envelope = np.abs(hilbert(sosfiltfilt(band, lateral - lateral.mean())))
        paths.append(envelope[150:-150:2])
    return paths, float(np.percentile(np.concatenate(paths), 95.0))


def terms() -> list[Callable[[np.ndarray, np.ndarray], np.ndarray]]:
    """Return the five known terms of Eq. (24) as functions of r and eps."""
    return [
        lambda r, e: e * r,
        lambda r, e: r**3 + 0.0 * e,
        lambda r, e: e**2 * r,
        lambda r, e: e * r**3,
        lambda r, e: r**5 + 0.0 * e,
    ]


def sindy(records: Sequence[Record], weak: bool) -> NormalForm | None:
    """Fit the five known terms with pysindy, v_c being told to it."""
    import pysindy as ps

    form = PAPER_NORMAL_FORM
    paths, size = radii(records)
    data = []
    for record, path in zip(records, paths, strict=True):
        eps = float(form.detuning(np.median(record['speed'].values)))
        data.append(np.stack([path / size, np.full(path.size, eps)], axis=1))
    time_s = np.arange(paths[0].size) * 0.02
    library = ps.CustomLibrary(library_functions=terms())
    options: dict[str, object] = {}
    if weak:
        np.random.seed(0)  # noqa: NPY002 - the peer draws its windows from numpy's global state
        library = ps.WeakPDELibrary(library, spatiotemporal_grid=time_s, K=100, H_xt=[4.0])
    else:
        options['differentiation_method'] = ps.SmoothedFiniteDifference()
    model = ps.SINDy(
        optimizer=ps.STLSQ(threshold=0.0, alpha=1e-10, normalize_columns=True),
        feature_library=library,
        **options,
    )
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        model.fit(data, t=time_s)
        found = np.asarray(model.coefficients())[0][:5]
    unit = (size / (2.0 * form.length_scale)) ** 2
    d1, d4, d7, d10, d15 = found * form.time_scale / np.array([1, unit, 1, unit, unit**2])
    return NormalForm(8.0, float(d1), float(d4), float(d7), float(d10), float(d15))
