"""The drawn numbers of names, in the result: each once, whatever formulas read it."""

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems, parse_key
from eqt_cli.base.store_writer import Variable
from eqt_cli.base.stored import POINT
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.study import Study


@purposes.variables_of_a_result
def variables(study: Study) -> dict[str, Variable]:
    """Return the numbers of all names as variables of a result, as drawn numbers are."""
    if study.base.config.draws is None:
        return {}
    swept = study.sweep.sets if study.sweep else ()
    by_point = any(parse_key(key)[0] in ("draws", "ensemble") for key in swept)
    points = [study.experiment(k) for k in range(len(study))] if by_point else [study.base]
    every = [_numbers(experiment) for experiment in points]
    dims = (POINT, "run") if by_point else ("run",)
    return {
        f"drawn.draws.{name}": Variable(
            dims,
            np.array([of[name] for of in every]) if by_point else values,
            {"units": "1", "long_name": f"draws.{name}, drawn"},
        )
        for name, values in every[0].items()
    }


def _numbers(experiment: Experiment) -> dict[str, Array]:
    from eqt_cli.extensions.draws.formulas import names_of  # which few configurations need

    names = names_of(experiment.document, Problems(), lambda *of: of[2]())
    assert names is not None
    ensemble = experiment.config.ensemble
    of_runs = [names.of(ensemble.seed, run) for run in range(ensemble.runs)]
    return {name: np.array([of[name] for of in of_runs]) for name in names.names}
