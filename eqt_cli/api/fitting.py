"""Compares a model with a recording, by its recorded wrench, and fits the model to it."""

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
from eqt_cli.controllers.replay import Replay, hold_named
from eqt_cli.core.errors import EqtError
from eqt_cli.experiment.build import Experiment, build
from eqt_cli.fitting import plant_fit
from eqt_cli.fitting.growth import Growth, growth
from eqt_cli.fitting.plant_fit import PlantFit
from eqt_cli.fitting.prediction import Windows, driven
from eqt_cli.fitting.written import check_folder, write_fitted
from eqt_cli.tuning.law_search import without_search

WINDOWS, OF_FIT = 10, 20
"""Of the length of a recording: the windows that are predicted, and those of a fit."""

MOST_WINDOWS = 50
"""That are predicted, unless told otherwise."""


def replay(
    config: Configuration | ConfigSource,
    measured: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    format: str = "csv",
    hold: str = "zero",
    horizon: float | None = None,
    windows: int = MOST_WINDOWS,
    out: str | os.PathLike[str] | None = None,
    trust_plugins: bool = False,
) -> Growth:
    r"""How the error of a model grows with the horizon, where the recorded wrench drives it.

    From many rows of a recording, the plant of a configuration starts in the recorded state. Its
    laws, its clock and its sensors take no part.

    Parameters
    ----------
    config
        A configuration, as of `load_experiment`: its group, inertia, plant, actuators and solver.
    measured
        The recording: poses, wrenches, and perhaps velocities.
    mapping, format
        As of `check_log`.
    hold
        How the wrench goes on behind a row: ``zero`` holds it, ``linear`` interpolates.
    horizon
        The longest that is predicted, s; if not given, a tenth of the recording.
    windows
        At most so many rows to start from, spread over the recording.
    out
        A folder for the figure ``replay``, as PDF, SVG and PNG.
    trust_plugins
        Execute plugin sources that are stored in a result.

    Returns
    -------
    Growth
        The error of each part at up to ten horizons: median, quantiles, and what noise alone gives.

    Raises
    ------
    ConfigError
        With every problem of the configuration, or of the mapping.
    EqtError
        If the file has no wrench, no stretch as long as the horizon without a gap, or the plant
        has parts whose state no recording tells.

    Examples
    --------
    A wheel of 2 kg m² under 1 N m, where the model has 1 kg m²:

    >>> from pathlib import Path
    >>> rows = [f"{t},{t * t / 4},{t / 2},1" for t in (k / 10 for k in range(41))]
    >>> _ = Path("wheel.csv").write_text("\n".join(["t,angle,wz,tz", *rows]))
    >>> config = {
    ...     "group": "SO2",
    ...     "inertia": 1.0,
    ...     "gains": {"kp": 1.0, "kd": 1.0},
    ...     "reference": {"kind": "constant"},
    ...     "controllers": ["eqt"],
    ...     "plant": {"inertia": {"relative": 0.0}},
    ...     "time": {"duration": 1.0},
    ... }
    >>> found = eqt_cli.replay(config, "wheel.csv", horizon=1.0, windows=5)
    >>> float(found.median[0, -1].round(6))  # ½ (1 − ½) rad/s² · 1 s²
    0.25
    """
    base, cut, plant = _opened(
        config, measured, mapping, format, hold, horizon, WINDOWS, trust_plugins
    )
    if windows < 1:
        raise EqtError(f"windows: expected 1 or more, got {windows}")
    found = growth(plant(base), base.engine, cut, windows)
    found = replace(found, notes=tuple(_notes(base, cut)))
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
    horizon: float | None = None,
    out: str | os.PathLike[str] | None = None,
    trust_plugins: bool = False,
) -> PlantFit:
    r"""Find the numbers of a plant with which it predicts a recording best.

    Least squares of the errors of replayed windows, each divided by the noise of the recording. The
    configuration with the numbers is written as ``fitted.yaml``.

    Parameters
    ----------
    config, measured, mapping, format, hold, trust_plugins
        As of `replay`. The search starts at the numbers of the configuration.
    over
        Keys of numbers in `inertia`, `plant` and `actuators`; ``linear[0:3]`` is one number for
        three entries.
    horizon
        The length of a window, s; if not given, a twentieth of the recording.
    out
        The folder; ``results/<name>-fitted`` if not given.

    Returns
    -------
    PlantFit
        The numbers with their intervals, and the errors before and after.

    Raises
    ------
    ConfigError, EqtError
        As of `replay`; and for keys that are no numbers of the plant, or that the recording does
        not tell.

    Examples
    --------
    A wheel of 2 kg m² under 1 N m, where the model has 1 kg m² to start with:

    >>> from pathlib import Path
    >>> rows = [f"{t},{t * t / 4},{t / 2},1" for t in (k / 10 for k in range(41))]
    >>> _ = Path("wheel.csv").write_text("\n".join(["t,angle,wz,tz", *rows]))
    >>> config = {
    ...     "group": "SO2",
    ...     "inertia": 1.0,
    ...     "gains": {"kp": 1.0, "kd": 1.0},
    ...     "reference": {"kind": "constant"},
    ...     "controllers": ["eqt"],
    ...     "plant": {"inertia": {"relative": 0.0}},
    ...     "time": {"duration": 1.0},
    ... }
    >>> found = eqt_cli.fit(config, "wheel.csv", ["plant.inertia.relative"], horizon=0.5)
    >>> round(found.numbers[0].value, 4)
    1.0
    """
    base, cut, plant = _opened(
        config, measured, mapping, format, hold, horizon, OF_FIT, trust_plugins
    )
    folder = Path("results") / f"{base.name}-fitted" if out is None else Path(out)
    check_folder(folder)
    found = plant_fit.fit(base, over, cut, plant)
    written = write_fitted(found, folder)
    return replace(found, config=written, notes=tuple(_notes(base, cut)))


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
    """An experiment, the recording in windows, and what makes of an experiment the driven plant."""
    source = config if isinstance(config, ConfigSource) else source_from(config, {})
    data = without_search(source.data)
    base = build(replace(source, data=data), trust_plugins=trust_plugins)
    recording = read_measured(measured, base.group, mapping, format)
    recording.require_wrenches()
    if horizon is None:
        horizon = float(recording.times[-1] - recording.times[0]) / parts
    if not horizon > 0:
        raise EqtError(f"horizon: expected a time greater than 0 s, got {horizon:g}")
    law = Replay(file=recording.name, hold=hold_named(hold)).holds(recording)
    return base, Windows(recording, horizon), lambda one: driven(one, law)


def _notes(base: Experiment, windows: Windows) -> Iterator[str]:
    yield from (f"{windows.recording.name}: {note}." for note in windows.recording.notes)
    if left := [name for name in ("control", "sensors") if name in base.resolved]:
        yield (
            f"{' and '.join(left)} of the configuration are left out: the recorded wrench acts "
            "when it was recorded."
        )
