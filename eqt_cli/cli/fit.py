"""`eqt replay` and `eqt fit`: a model of the plant against a recording."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from eqt_cli.cli.shared import completion, options
from eqt_cli.cli.shared.output import laid_out, print_found, say
from eqt_cli.core.errors import EqtError

if TYPE_CHECKING:
    from eqt_cli.fitting.growth import Growth
    from eqt_cli.fitting.plant_fit import PlantFit

Measured = Annotated[Path, options.option("--measured")]
Hold = Annotated[str, options.option("--hold", autocompletion=completion.words("zero", "linear"))]
Delay = Annotated[float, options.option("--delay")]


def replay(
    config: options.Config,
    measured: Measured,
    mapping: options.Mapping = None,
    log_format: options.LogFormat = "csv",
    hold: Hold = "zero",
    delay: Delay = 0.0,
    horizon: Annotated[float | None, options.option("--horizon")] = None,
    windows: Annotated[int, options.option("--windows", min=1)] = 50,
    set_: options.Set = None,
    engine: options.Engine = None,
    out: Annotated[Path | None, options.option("--out", parser=options.folder)] = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Drive the plant with a recorded wrench and print how the error grows with the horizon.

    Each window starts at a recorded state. The control laws of the configuration are not used.

    Options
    -------
    Experiment
        --measured FILE  Recording with poses and wrenches.
        --hold NAME  The wrench between two rows: zero holds the earlier one, as an autopilot
            does; linear interpolates.
        --delay S  Time by which the wrench was recorded late, s.
        --horizon S  Length of a window, s. Default: a tenth of the recording.
        --windows N  Largest number of windows.
    Result
        --out DIR  Folder for the figure replay.
    """
    from eqt_cli import api
    from eqt_cli.fitting.growth import growth_table

    growth = api.replay(
        options.source_of(config, set_, engine),
        measured,
        mapping,
        format=log_format,
        hold=hold,
        delay=delay,
        horizon=horizon,
        windows=windows,
        out=out,
        trust_plugins=trust_plugins,
    )
    print_found(_plain(growth), laid_out(growth_table(growth)), json=json)
    if out is not None:
        say(f"figure in {out}")


def fit(
    config: options.Config,
    measured: Measured,
    over: Annotated[str, options.option("--over")],
    mapping: options.Mapping = None,
    log_format: options.LogFormat = "csv",
    hold: Hold = "zero",
    delay: Delay = 0.0,
    horizon: Annotated[float | None, options.option("--horizon")] = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    out: Annotated[Path | None, options.option("--out", parser=options.folder)] = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Fit numbers of the plant to a recording, with 95 % intervals.

    The configuration with the fitted numbers is written to results/NAME-fitted/fitted.yaml.

    Options
    -------
    Experiment
        --measured FILE  Recording with poses and wrenches.
        --hold NAME  The wrench between two rows: zero holds the earlier one, as an autopilot
            does; linear interpolates.
        --delay S  Time by which the wrench was recorded late, s.
        --over KEYS  Numbers of the plant to find, separated by commas, such as
            plant.inertia.relative,plant.forces[0].linear; delay is that of the wrench.
        --horizon S  Length of a window, s. Default: a twentieth of the recording.
    Result
        --out DIR  Folder for fitted.yaml.
    """
    from eqt_cli import api
    from eqt_cli.fitting.plant_fit import fit_tables

    if "=" in over:
        key = over.partition("=")[0].strip()
        raise EqtError(f"--over: expected keys without values, such as '{key}', got '{over}'")
    fitted = api.fit(
        options.source_of(config, set_, engine),
        measured,
        [key.strip() for key in over.split(",") if key.strip()],
        mapping,
        format=log_format,
        hold=hold,
        delay=delay,
        horizon=horizon,
        out=out,
        trust_plugins=trust_plugins,
    )
    numbers, residuals = map(laid_out, fit_tables(fitted))
    print_found(_plain(fitted), numbers, "", residuals, "", str(fitted.config), json=json)


def _plain(findings: Growth | PlantFit) -> dict[str, Any]:
    """Return the findings in types that JSON can hold."""
    values = {each.name: getattr(findings, each.name) for each in fields(findings)}
    return {name: _entry(value) for name, value in values.items() if name != "source"}


def _entry(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [vars(each) if hasattr(each, "__dict__") else each for each in value]
    return str(value) if isinstance(value, Path) else getattr(value, "tolist", lambda: value)()
