"""eqt: experiments with equivariant tracking control on matrix Lie groups.

In notebooks and scripts::

    import eqt_cli

    experiment = eqt_cli.load_experiment("configs/paper.yaml", {"ensemble.runs": 50})
    result = eqt_cli.run(experiment)
    data = eqt_cli.open_results(result)  # an xarray Dataset
    eqt_cli.compare(result, metrics=["mean_torque"], windows=["0:5"])
    eqt_cli.verify(result).failures
    eqt_cli.plot(result, "paper", options={"log": True})
    eqt_cli.write_report(result)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eqt_cli.core.version import __version__

if TYPE_CHECKING:
    from eqt_cli.api import (
        LoadedExperiment,
        StoredResult,
        compare,
        load_experiment,
        open_results,
        plot,
        run,
        tune,
        verify,
        write_report,
    )

__all__ = [
    "LoadedExperiment",
    "StoredResult",
    "__version__",
    "compare",
    "load_experiment",
    "open_results",
    "plot",
    "run",
    "tune",
    "verify",
    "write_report",
]


def __getattr__(name: str) -> Any:
    """The Python interface, imported when it is first used: the command line starts without it."""
    if name in __all__:
        from eqt_cli import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *__all__]
