"""DOP853 in Python: the dense output by a closed form, and the end of what blows up."""

from functools import partial

import numpy as np

from eqt_cli.engines import dop853

RTOL = 1e-9

solve = partial(dop853.solve, events=lambda t, y: 1.0, first_step=None, rtol=RTOL, atol=1e-3 * RTOL)


def test_samples_within_and_at_the_ends_of_steps():
    times = np.linspace(0.5, 20.0, 778)
    exact = np.array([np.sin(times), np.cos(times)])
    found = solve(lambda t, y: np.array([y[1], -y[0]]), (0.5, 20.0), exact[:, 0], t_eval=times)
    # The error of the phase grows by at most about rtol in each of some thirty steps.
    np.testing.assert_allclose(found.y, exact, rtol=0, atol=30 * RTOL)
    ends = solve(lambda t, y: np.array([y[1], -y[0]]), (0.5, 20.0), exact[:, 0], t_eval=None)
    np.testing.assert_array_equal(ends.y, found.y[:, [0, -1]])


def test_a_solution_without_end_needs_ever_smaller_steps():
    with np.errstate(all="ignore"):
        found = solve(lambda t, y: y * y, (0.0, 2.0), np.ones(1), t_eval=None)
    assert (found.status, found.message) == (-1, "the step size is too small")
