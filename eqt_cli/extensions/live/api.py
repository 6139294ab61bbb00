"""Writes experiments that run in a page."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eqt_cli.api.loading import load_experiment, open_at
from eqt_cli.api.running import run
from eqt_cli.base.errors import EqtWarning
from eqt_cli.base.files import FILE_NAME, check_targets, write_all
from eqt_cli.base.reporting import reporter
from eqt_cli.base.yaml_source import flow
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Engine
from eqt_cli.engines.native import SMALLEST_RTOL, Native


def live(
    config: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    keys: Mapping[str, str] | None = None,
    overrides: Mapping[str, Any] | None = None,
    title: str = "",
    workers: int = 1,
) -> Path:
    """Write a page in which an experiment runs again at every move of a slider.

    The page needs no network and no eqt. Its numbers have the bits of the engine `native` where the
    browser can round a b + c once; else it says how much they differ.

    Parameters
    ----------
    config
        A configuration, which is run first; or a result, whose numbers are taken.
    out
        The page.
    keys
        Ranges ``LOW:HIGH`` or ``LOW:HIGH:STEP`` of the keys to move. Default: gains, moments of
        inertia and the start.
    overrides
        Values by key, as for `load_experiment`.
    title
        Title of the page. Default: as of a report.
    workers
        Number of cores that run the experiment.

    Returns
    -------
    Path
        The written page.

    Raises
    ------
    EqtError
        If the experiment cannot run in a page, or there is no compiler for it; it says why.

    Examples
    --------
    >>> eqt_cli.live("configs/paper.yaml", "paper.html", keys={"gains.kp": "0.1:10"}).name
    'paper.html'
    """
    from eqt_cli.extensions.live import document, wasm

    config, out = Path(config), Path(out)
    check_targets([out], out.parent)
    wasm.command()
    study = load_experiment(config, overrides)
    if study.sweep is not None:
        reporter().remark(EqtWarning(f"{config}: the page is written without its sweep"))
        overrides = {**(overrides or {}), "sweep": None}
        study = load_experiment(config, overrides)
    settings = {**(overrides or {}), **_engine(study.base.engine)}
    words = ["eqt", "run", config.name if config.is_absolute() else str(config)]
    words += [] if isinstance(study.base.engine, Native) else ["--engine", "native"]
    for key, value in (overrides or {}).items():
        words += ["--set", f"{key}={flow(value)}"]

    def moved(setting: Mapping[str, Any]) -> Study:
        return load_experiment(config, {**settings, **setting})

    is_result = (config / FILE_NAME).exists() or config.suffix == ".h5"
    if is_result and not overrides:
        with open_at(config) as result:
            study = moved({"ensemble.runs": result["status"].shape[1]})
            text = document.live_page(study, moved, result, keys or {}, words, title)
    else:
        settings["ensemble.runs"] = document.runs_of(moved({}))
        with tempfile.TemporaryDirectory() as folder:
            study = moved({"store.trajectories": 1})
            run(study, folder, workers=workers)
            with open_at(folder) as result:
                text = document.live_page(study, moved, result, keys or {}, words, title)
    write_all({out: text.encode()}, out.parent)
    return out


def _engine(engine: Engine) -> dict[str, Any]:
    """Return the settings by which the engine native computes what another engine does."""
    if isinstance(engine, Native):
        return {}
    rtol, atol = max(engine.rtol, SMALLEST_RTOL), getattr(engine, "atol", 1e-12)
    return {"solver": {"engine": "native", "rtol": rtol, "atol": atol}}


def ranges(texts: Sequence[str]) -> dict[str, str]:
    """Return the ranges of sliders by key, from texts ``KEY=LOW:HIGH`` or ``KEY``."""
    keys = {}
    for text in texts:
        key, _, range_ = text.partition("=")
        keys[key.strip()] = range_.strip()
    return keys
