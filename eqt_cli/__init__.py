"""eqt: experiments with equivariant tracking control on matrix Lie groups.

In notebooks and scripts::

    import eqt_cli

    experiment = eqt_cli.load_experiment("configs/paper.yaml", {"ensemble.runs": 50})
    result = eqt_cli.run(experiment)
    result.metrics().groupby("controller").mean_torque.mean()
    data = result.to_xarray()
    eqt_cli.compare(result, metrics=["mean_torque"], windows=["0:5"])
    eqt_cli.plot(result, "summary", options={"log": True})
    eqt_cli.report(result)

The names in `STABLE` stay, with their arguments and what they return. Before one of them changes,
two minor releases warn (`DeprecationWarning`) and name what replaces it. All other names, also
those of `eqt_cli.api`, are provisional: any release may change them, and its changelog says so.
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

__path__ += map(str, Path(__path__[0]).glob("extensions/*/names"))  # as `eqt_cli.gym`

STABLE = {
    "load_experiment": "eqt_cli.api.loading",
    "run": "eqt_cli.api.running",
    "sweep": "eqt_cli.api.running",
    "tune": "eqt_cli.extensions.search.api",
    "worst": "eqt_cli.extensions.search.api",
    "open_result": "eqt_cli.api.loading",
    "compare": "eqt_cli.api.comparing",
    "plot": "eqt_cli.api.drawing",
    "report": "eqt_cli.extensions.report.api",
    "verify": "eqt_cli.extensions.proofs.verification",
    "margins": "eqt_cli.extensions.proofs.margins",
    "export": "eqt_cli.extensions.export.export",
    "__version__": "eqt_cli.base.version",
}
"""The public names, and the modules that define them."""

__all__ = [*STABLE]


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    """Return the object of a name, and import its module, for example Matplotlib, only now."""
    module = import_module(STABLE.get(name, "eqt_cli.api"))
    if name not in STABLE and name not in module.__all__:
        message = f"module 'eqt_cli' has no attribute {name!r}"
        raise AttributeError(message, name=name, obj=sys.modules[__name__])
    value = globals()[name] = getattr(module, name)
    return value
