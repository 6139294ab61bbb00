"""Writes experiments that run in a page."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.api.loading import load_experiment, open_at
from eqt_cli.api.running import run
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.base.files import FILE_NAME, check_targets, write_all
from eqt_cli.base.reporting import reporter
from eqt_cli.base.yaml_source import flow
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Engine
from eqt_cli.engines.native import SMALLEST_RTOL, Native
from eqt_cli.results.result import Result

if TYPE_CHECKING:
    from eqt_cli.extensions.live.document import LivePage


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
        Ranges ``LOW:HIGH`` or ``LOW:HIGH:STEP`` of the keys to move. Default: those of `live` in
        the configuration, or gains, moments of inertia and the start.
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

    config, out, overrides = Path(config), Path(out), dict(overrides or {})
    check_targets([out], out.parent)
    wasm.command()
    study = load_experiment(config, overrides)
    if study.sweep is not None:
        reporter().remark(EqtWarning(f"{config}: the page is written without its sweep"))
        overrides["sweep"] = None
        study = load_experiment(config, overrides)
    document.check_keys(study, keys or {})
    words = ["eqt", "run", config.name if config.is_absolute() else str(config)]
    for key, value in overrides.items():
        words += ["--set", f"{key}={flow(value)}"]
    with ExitStack() as opened:
        is_result = (config / FILE_NAME).exists() or config.suffix == ".h5"
        if is_result and not overrides:
            result = opened.enter_context(open_at(config))
        else:
            folder = opened.enter_context(tempfile.TemporaryDirectory())
            runs = {"ensemble.runs": document.runs_of(study), "store.trajectories": 1}
            changed = {**overrides, **_engine(study.base.engine), **runs}
            run(load_experiment(config, changed), folder, workers=workers)
            result = opened.enter_context(open_at(folder))

        def load(setting: Mapping[str, Any]) -> Study:
            return load_experiment(config, {**overrides, **setting})

        text = _page(load, result, words).whole(keys or {}, title)
    write_all({out: text.encode()}, out.parent)
    return out


def report_part(result: Result, trusted: bool = False) -> dict[str, str]:
    """Return the part of a report with sliders, its `html` and `css`; raises as `live`."""
    from eqt_cli.config.document import document_of, overridden
    from eqt_cli.config.study import study
    from eqt_cli.extensions.live import wasm

    if result.is_sweep:
        raise EqtError("--live: applies to one experiment; choose a point with --point")
    wasm.command()
    stored = document_of(result, trusted)

    def changed(setting: Mapping[str, Any]) -> Study:
        return study(overridden(stored, [f"{key}={flow(x)}" for key, x in setting.items()]))

    # The report offers its configuration under this name.
    return _page(changed, result, ["eqt", "run", "config.yaml"]).part()


def _page(
    load: Callable[[Mapping[str, Any]], Study], result: Result, command: list[str]
) -> LivePage:
    """Return the page of a result; `load` gives its experiment with other values of keys."""
    from eqt_cli.extensions.live.document import LivePage

    engine = load({}).base.engine
    command += [] if isinstance(engine, Native) else ["--engine", "native"]
    settings = {"ensemble.runs": result["status"].shape[1], **_engine(engine)}
    return LivePage(lambda setting: load({**settings, **setting}), result, command)


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
