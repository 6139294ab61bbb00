"""What every set of claims must be, whoever wrote it."""

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.components.laws import controllers

CONFIG = mapping(
    controllers=["eqt"], ensemble={"runs": 5, "seed": 1}, time={"duration": 6.0, "samples": 13}
)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("claims")
    return api.run(api.load_experiment(CONFIG, {"name": "claims"}), folder / "out")


def rows(claim_class):
    return [row for claim in claim_class.claims for row in claim.rows]


def test_it_says_who_claims_what_of_known_laws(claim_class):
    assert claim_class.source
    assert all(claim.says and claim.rows for claim in claim_class.claims)
    assert {kind for row in rows(claim_class) for kind in row.kinds} <= set(controllers.names())


def test_its_measures_are_known(claim_class, result):
    for measure in {row.measure for row in rows(claim_class)}:
        assert api.compare(result, metrics=[measure]).levels


def test_bounds_and_windows_are_numbers(claim_class):
    for row in rows(claim_class):
        if hasattr(row, "bound"):
            assert np.isfinite(row.bound)
            assert row.statement
        else:
            assert row.lesser != row.greater
