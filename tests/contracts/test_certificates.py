"""What every certificate must be, whoever wrote it."""

import dataclasses

import numpy as np
import pytest
from small_experiment import mapping
from small_loops import expressions

from eqt_cli import api
from eqt_cli.components.inertia import PrescribedInertia
from eqt_cli.components.laws import controllers
from eqt_cli.components.references import references
from eqt_cli.extensions.proofs.certificates import Identity, Verdict, certificates
from eqt_cli.extensions.proofs.sample import sampled
from eqt_cli.extensions.underactuated.certificates import CommandedRates

CONFIG = mapping(controllers=["eqt", "nog"], ensemble={"runs": 2, "seed": 1})
IDENTITIES = [
    found
    for found in certificates.all()
    if issubclass(found, Identity) and found is not CommandedRates  # see test_cascade.py
]


def test_names_tell_rows_apart():
    names = [found.name for found in certificates.all()]
    assert len(names) == len(set(names))


@pytest.fixture(scope="module")
def drawn():
    """Samples by their numbers, as they are asked for."""
    return {}


@pytest.fixture
def samples(loop_with, make, drawn):
    """Of EqT along a path, with an inertia that varies, and of every law."""
    inertia = [["2 + sin(t)", "0", "0.1"], ["0", "3", "0"], ["0.1", "0", "4"]]
    loops = [
        dataclasses.replace(
            loop_with(reference=make(references.get("path"), 3)),
            inertia=PrescribedInertia(expressions(inertia)),
        ),
        *(loop_with("SO3", kind()) for kind in controllers.all() if kind.tasks),
    ]
    for number, loop in enumerate(loops):
        if number not in drawn:
            drawn[number] = sampled("law", loop, 5.0, np.random.default_rng(0))
    return drawn.values()


@pytest.mark.parametrize("identity", IDENTITIES, ids=lambda found: found.name)
def test_an_identity_fails_where_a_side_is_a_thousandth_off(identity, samples, monkeypatch):
    """And holds where none is: so neither is it 0 = 0, nor its bound a loose one."""
    about = (sample for sample in samples if identity().applies(sample.loop))
    sample, [row] = next((each, rows) for each in about if (rows := identity().check(each)))
    exact = identity.sides
    monkeypatch.setattr(
        identity,
        "sides",
        lambda self, sample: [(1.001 * left, right) for left, right in exact(self, sample)],
    )
    [off] = identity().check(sample)
    assert (row.verdict, off.verdict) == (Verdict.HOLDS, Verdict.FAILS)


def test_certificates_of_plugins_join_those_of_eqt(load_plugins, tmp_path):
    experiment = api.load_experiment(CONFIG)
    before = api.verify(experiment).rows
    load_plugins("certificates")
    after = api.verify(experiment).rows
    mine = ["the g-term has no power", "the error ends small", "the reference moves"]
    assert {row.name for row in after} - {row.name for row in before} == set(mine)
    assert [row for row in after if row.name not in mine] == list(before)
    assert all(row.verdict == "holds" for row in after if row.name == mine[0])
