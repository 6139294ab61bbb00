"""Thrusters at places and along directions that each run draws."""

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli.components.groups import group_named
from eqt_cli.config.schema import Config
from eqt_cli.extensions.thrusters.thrusters import Thrusters

PLACES = [(0.3, 0, 0), (-0.3, 0, 0), (0, 0.3, 0), (0, -0.3, 0), (0, 0, 0.3), (0, 0, -0.3)]
ALONG = [(0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (1, 0, 0), (1, 0, 0)]


def columns(places, along):
    """B by hand: r × a over a, of unit directions."""
    along = np.array(along, float) / np.linalg.norm(along, axis=1)[:, None]
    return np.vstack([np.cross(places, along).T, along.T])


@pytest.mark.parametrize("told", [False, True])
def test_thrusts_are_allocated_for_the_means(told):
    """The torque is B B₀⁻¹ of the command, with B₀ of the nominal places; B of the drawn ones."""
    rows = [{"at": list(at), "along": list(a)} for at, a in zip(PLACES, ALONG, strict=True)]
    rows[0] = {"at": [{"normal": [0.3, 0.01]}, 0, 0], "along": [0, 1, {"normal": [0, 0.05]}]}
    section = {"kind": "thrusters", "thrusters": rows, "told": told}
    inertia = {"urdf": [1, 0, 0, 1, 0, 1], "mass": 2}
    config = Config.model_validate(mapping(group="SE3", inertia=inertia, actuators=[section]))
    (part,) = config.actuators
    assert isinstance(part, Thrusters)
    G, draws = group_named("SE3"), np.random.default_rng(3)
    x, tilt = draws.normal(0.3, 0.01), draws.normal(0, 0.05)
    run = part.of_run(G, np.random.default_rng(3))
    true = columns([(x, 0, 0), *PLACES[1:]], [(0, 1, tilt), *ALONG[1:]])
    nominal = columns(PLACES, ALONG)
    command = np.array([1.0, -2.0, 3.0, 0.5, 0.25, -1.0])
    expected = command if told else true @ np.linalg.solve(nominal, command)
    assert np.abs(true - nominal).max() > 0.01
    np.testing.assert_allclose(
        run.output(G, command, np.empty(0)), expected, rtol=1e-12, atol=1e-13
    )
    np.testing.assert_allclose(part.columns(G), nominal, rtol=1e-15)
