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

from functools import partial

from eqt_cli.core.offered_names import imported, places

_PLACES = places(__name__)

__all__ = sorted(_PLACES)
__getattr__ = partial(imported, __name__, _PLACES)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
