"""The paper's experiment (Hampsey et al. (2025), section 7 and Figure 3), with 60 of 200 runs.

The values to expect were computed once, from other random numbers: each is a mean over 200 runs,
so that the difference of two such means has at most √2 times the standard error of one. Four of
these are allowed, which a normal variable exceeds once in 16,000 times, and the rounding of the
value. `make figures-check` compares the means over all 800 runs.
"""

import numpy as np
import pytest

from eqt_cli.base.store_reader import open_results

LABELS = ["eqt", "gt", "nog", "asym"]
MULTIPLE = 4 * np.sqrt(2)

START = {"pose_error": 2.4, "velocity_error": 1.6, "torque_norm": 1.8, "lyapunov": 4.8}
PEAK = {"eqt": 2.1, "gt": 2.5, "nog": 2.3, "asym": 2.9}
EARLY_TORQUE = {"eqt": 1.83, "gt": 2.06, "nog": 2.03, "asym": 2.33}
MEAN_POSE_ERROR = {"eqt": 0.67, "gt": 0.57, "nog": 0.85, "asym": 0.56}


@pytest.fixture(scope="module")
def paper(paper_result):
    with open_results(paper_result) as results:
        yield results


def assert_expected(values, expected, rounding):
    """That a mean over runs is the expected one within the sampling error of both."""
    error = values.std(ddof=1) / np.sqrt(len(values))
    assert abs(values.mean() - expected) < MULTIPLE * error + rounding


def test_every_run_of_every_controller_ends_well(paper):
    assert list(paper.coordinate("controller")) == LABELS
    assert paper["status"].shape == (4, 60)
    assert not paper["status"].any()


@pytest.mark.parametrize("name", START)
def test_where_the_curves_start(paper, name):
    # Since ω_d(0) = 0, all four laws start with the same torque, too.
    values = paper.read(name, controller=0, time=0)
    assert_expected(values, START[name], 0.05)


@pytest.mark.parametrize("label", LABELS)
def test_the_highest_mean_torque(paper, label):
    torque = paper.read("torque_norm", controller=LABELS.index(label))
    peak = torque.mean(axis=0).argmax()
    assert_expected(torque[:, peak], PEAK[label], 0.05)


@pytest.mark.parametrize("label", LABELS)
def test_the_mean_torque_of_the_first_five_seconds(paper, label):
    torque = paper.read("early_torque", controller=LABELS.index(label))
    assert_expected(torque, EARLY_TORQUE[label], 0.005)


@pytest.mark.parametrize("label", LABELS)
def test_the_mean_attitude_error(paper, label):
    error = paper.read("mean_pose_error", controller=LABELS.index(label))
    assert_expected(error, MEAN_POSE_ERROR[label], 0.005)


def test_all_controllers_stabilise(paper):
    lyapunov = paper["lyapunov"].mean(axis=1)
    # After 20 s a percent is left with nog, the slowest, and a tenth of that with the others.
    assert (lyapunov[:, -1] < 0.02 * lyapunov[:, 0]).all()


def test_eqt_needs_less_torque_than_gt_in_the_first_five_seconds(paper):
    eqt, gt = paper.read("early_torque", controller=[0, 1])
    assert_smaller(eqt, gt)


def test_the_attitude_error_of_eqt_decays_more_slowly_than_that_of_gt(paper):
    eqt, gt = paper.read("mean_pose_error", controller=[0, 1])
    assert_smaller(gt, eqt)


def assert_smaller(one, other):
    """In the mean over runs that start alike, by more than four standard errors."""
    difference = other - one
    assert difference.mean() > 4 * difference.std(ddof=1) / np.sqrt(len(difference))


def test_the_energy_balance_holds_for_every_run(paper):
    # Of the order of rtol = 1e-6, times what the worst run amplifies (70 times).
    assert paper["energy_residual"].max() < 1e-4
