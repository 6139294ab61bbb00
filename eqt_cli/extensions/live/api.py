"""Writes experiments that run in a page."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from eqt_cli.api.loading import load_experiment, open_at
from eqt_cli.api.running import run
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.base.files import FILE_NAME, check_targets, write_all
from eqt_cli.base.reporting import reporter
from eqt_cli.base.yaml_source import flow
from eqt_cli.config.study import Study
from eqt_cli.engines.native import Native
from eqt_cli.results.result import Result


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
    from eqt_cli.extensions.live import sliders, wasm
    from eqt_cli.extensions.live.document import LivePage, blank_result, experiments, for_a_page
    from eqt_cli.extensions.live.programs import refuse_foreign

    config, out, overrides, keys = Path(config), Path(out), dict(overrides or {}), keys or {}
    check_targets([out], out.parent)
    study = load_experiment(config, overrides)
    if study.sweep is not None:
        reporter().remark(EqtWarning(f"{config}: the page is written without its sweep"))
        overrides["sweep"] = None
    for key, range_ in keys.items():
        sliders.slider_of(study.document.data, key, range_)
    for label, loop in study.base.loops.items():
        refuse_foreign(loop, label)
    wasm.command()
    words = ["eqt", "run", config.name if config.is_absolute() else str(config)]
    words += [f"--set={key}={flow(value)}" for key, value in overrides.items()]
    words += _engine(study)
    load = experiments(study.document)
    is_result = (config / FILE_NAME).exists() or config.suffix == ".h5"
    with ExitStack() as opened:
        if is_result and not overrides:
            result = opened.enter_context(open_at(config))
            load = for_a_page(load, result["status"].shape[1])
            ready = LivePage(load, result, words, study.base.config.ensemble.runs).made_ready(keys)
        else:
            # What cannot go live is refused before anything runs.
            load = for_a_page(load)
            experiment = load({"store.trajectories": 1})
            form = opened.enter_context(blank_result(experiment))
            ready = LivePage(load, form, words, study.base.config.ensemble.runs).made_ready(keys)
            folder = opened.enter_context(tempfile.TemporaryDirectory())
            run(experiment, folder, workers=workers)
            result = opened.enter_context(open_at(folder))
        if ready.runs < ready.of_runs:
            some = f"{config}: the page has the first {ready.runs} of {ready.of_runs} runs"
            reporter().remark(EqtWarning(some))
        text = ready.whole(result, title)
    write_all({out: text.encode()}, out.parent)
    return out


@purposes.report_live
def report_part(result: Result, trusted: bool = False) -> dict[str, str]:
    """Return the part of a report with sliders, its `html` and `css`; raises as `live`."""
    from eqt_cli.config.document import document_of
    from eqt_cli.extensions.live import wasm
    from eqt_cli.extensions.live.document import LivePage, experiments, for_a_page

    if result.is_sweep:
        raise EqtError("--live: applies to one experiment; choose a point with --point")
    wasm.command()
    load = experiments(document_of(result, trusted))
    # The report offers its configuration under this name.
    study = load({})
    words, runs = ["eqt", "run", "config.yaml", *_engine(study)], result["status"].shape[1]
    load = for_a_page(load, runs)
    return (
        LivePage(load, result, words, study.base.config.ensemble.runs).made_ready({}).part(result)
    )


def _engine(experiment: Study) -> list[str]:
    """Return the words that choose the engine of the page."""
    return [] if isinstance(experiment.base.engine, Native) else ["--engine", "native"]


def ranges(texts: Sequence[str]) -> dict[str, str]:
    """Return the ranges of sliders by key, from texts ``KEY=LOW:HIGH`` or ``KEY``."""
    keys = dict[str, str]()
    for text in texts:
        key, _, range_ = map(str.strip, text.partition("="))
        if key in keys:
            raise EqtError(f"--key {text}: {key} has a slider already; leave one of them out")
        keys[key] = range_
    return keys
