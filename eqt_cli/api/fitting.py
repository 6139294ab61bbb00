"""Compares a model driven by a recorded wrench with the recording, and fits the model."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from eqt_cli.api.checking_logs import read_measured
from eqt_cli.api.loading import Configuration, source_from
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.config.source import ConfigSource
from eqt_cli.controllers.replay import Hold, Replay
from eqt_cli.core.errors import EqtError
from eqt_cli.experiment.build import build
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.fitting import plant_fit
from eqt_cli.fitting.growth import Growth, growth
from eqt_cli.fitting.plant_fit import PlantFit, check_folder, write_fitted
from eqt_cli.fitting.prediction import Windows, driven
from eqt_cli.logs.mapping import literal
from eqt_cli.tuning.law_search import without_search

WINDOWS, OF_FIT = 10, 20
"""Length of a recording divided by the default length of a window, for `replay` and for `fit`."""

MOST_WINDOWS = 50
"""Default largest number of predicted windows."""


def replay(
    config: Configuration | ConfigSource,
    measured: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    format: str = "csv",
    hold: str = "zero",
    delay: float = 0.0,
    horizon: float | None = None,
    windows: int = MOST_WINDOWS,
    out: str | os.PathLike[str] | None = None,
    trust_plugins: bool = False,
) -> Growth:
    """Predict a recording from many of its rows, and measure the growth of the error.

    The plant of a configuration starts in the recorded states, and the recorded wrench drives it.
    Control laws, control clock and sensors of the configuration are not used.

    Parameters
    ----------
    config
        A configuration as for `load_experiment`. Its group, inertia, plant, actuators and solver
        are used.
    measured
        The recording, with poses, wrenches and possibly velocities.
    mapping, format
        As for `check_log`.
    hold
        Wrench between two rows: ``zero`` holds the first one, ``linear`` interpolates.
    delay
        The time by which the wrench was recorded late, s: at t acts the recorded wrench of
        t + delay. The plant is moved in time for it, with whatever else depends on time.
    horizon
        Longest prediction, s. Default: a tenth of the recording.
    windows
        Largest number of start rows, which are spread over the recording.
    out
        Output folder for the figure ``replay`` as PDF, SVG and PNG. Default: no figure.
    trust_plugins
        Whether to execute plugin sources that are stored in a result.

    Returns
    -------
    Growth
        The error of each part at up to ten horizons: median, quantiles, and the error due to noise.

    Raises
    ------
    ConfigError
        With all problems of the configuration or of the mapping.
    EqtError
        If the recording has no wrench or no section of this length without a gap, or if a part of
        the plant has a state that recordings do not contain.

    Examples
    --------
    The recording of a wheel of 2 kg m² under 1 N m. The model has 0.4 kg m²:

    >>> import numpy as np
    >>> t = np.linspace(0, 4, 41)
    >>> rows = np.stack([t, t**2 / 4, t / 2, 0 * t + 1], axis=1)
    >>> np.savetxt("wheel.csv", rows, delimiter=",", header="t,angle,wz,tz", comments="")
    >>> found = eqt_cli.replay("configs/so2.yaml", "wheel.csv", horizon=1.0)
    >>> float(found.median[0, -1].round(6))  # ½ (1/0.4 − 1/2) rad/s² · (1 s)²
    1.0
    """
    base, cut, plant = _opened(
        config, measured, mapping, format, hold, horizon, WINDOWS, trust_plugins
    )
    if windows < 1:
        raise EqtError(f"windows: expected 1 or more, got {windows}")
    found = growth(plant(base), base.engine, cut, windows, delay)
    found = replace(found, notes=(*found.notes, *_notes(base, cut)))
    if out is not None:
        from eqt_cli.plots.growth import save_growth  # slow to import

        save_growth(found, Path(out))
    return found


def fit(
    config: Configuration | ConfigSource,
    measured: str | os.PathLike[str],
    over: Sequence[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    format: str = "csv",
    hold: str = "zero",
    delay: float = 0.0,
    horizon: float | None = None,
    out: str | os.PathLike[str] | None = None,
    trust_plugins: bool = False,
) -> PlantFit:
    """Fit numbers of a plant so that it predicts a recording best.

    The fit minimises the sum of the squared errors of replayed windows, each divided by the noise
    of the recording. The fitted configuration is written as ``fitted.yaml``.

    Parameters
    ----------
    config, measured, mapping, format, hold, delay, trust_plugins
        As for `replay`. The search starts at the numbers of the configuration.
    over
        Keys of numbers in `inertia`, `plant` and `actuators`; ``linear[0:3]`` is one number for
        three entries. ``delay`` finds the delay of the wrench, from the one that is given.
    horizon
        Length of a window, s. Default: a twentieth of the recording.
    out
        Output folder. Default: ``results/<name>-fitted``.

    Returns
    -------
    PlantFit
        The numbers with their intervals, and the errors before and after the fit.

    Raises
    ------
    ConfigError, EqtError
        As for `replay`. Also if a key is not a number of the plant, or the recording does not
        determine it.

    Examples
    --------
    The recording of a wheel of 2 kg m² under 1 N m. The search starts at 0.4 kg m²:

    >>> import numpy as np
    >>> t = np.linspace(0, 4, 41)
    >>> rows = np.stack([t, t**2 / 4, t / 2, 0 * t + 1], axis=1)
    >>> np.savetxt("wheel.csv", rows, delimiter=",", header="t,angle,wz,tz", comments="")
    >>> found = eqt_cli.fit("configs/so2.yaml", "wheel.csv", ["inertia"], horizon=0.5)
    >>> round(found.numbers[0].value, 4)
    2.0
    """
    base, cut, plant = _opened(
        config, measured, mapping, format, hold, horizon, OF_FIT, trust_plugins
    )
    folder = Path("results") / f"{base.name}-fitted" if out is None else Path(out)
    check_folder(folder)
    found = plant_fit.fit(base, over, cut, plant, delay)
    written = write_fitted(found, folder)
    return replace(found, config=written, notes=(*found.notes, *_notes(base, cut)))


def _opened(
    config: Configuration | ConfigSource,
    measured: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None,
    format: str,
    hold: str,
    horizon: float | None,
    parts: int,
    trust_plugins: bool,
) -> tuple[Experiment, Windows, Callable[[Experiment], ClosedLoop]]:
    """Return the experiment, the windows of the recording, and a function that drives its plant."""
    source = config if isinstance(config, ConfigSource) else source_from(config, {})
    data = without_search(source.data)
    base = build(replace(source, data=data), trust_plugins=trust_plugins)
    recording = read_measured(measured, base.group, mapping, format)
    recording.require_wrenches()
    if horizon is None:
        horizon = float(recording.times[-1] - recording.times[0]) / parts
    if not horizon > 0:
        raise EqtError(f"horizon: expected a time greater than 0 s, got {horizon:g}")
    law = Replay(file=recording.name, hold=literal(Hold, "hold", hold)).with_recording(recording)
    return base, Windows(recording, horizon), lambda one: driven(one, law)


def _notes(base: Experiment, windows: Windows) -> Iterator[str]:
    yield from (f"{windows.recording.name}: {note}." for note in windows.recording.notes)
    if left := [name for name in ("control", "sensors") if name in base.resolved]:
        yield (
            f"{' and '.join(left)} of the configuration are left out: the recorded wrench acts "
            "when it was recorded."
        )
