"""What every control law must do, whoever wrote it."""

import pickle
import re

import numpy as np
import pytest

from eqt_cli.components.laws import memory_gradient
from eqt_cli.extend import Problems
from eqt_cli.numbers.leaves import leaves, with_leaves

# Tens of last places of torques up to a hundred.
ROUNDING = 1e-11
# Central differences of L over ±1e-4 s: the third derivative of energies up to a hundred times
# 1e-8, and rounding over 1e-4; measured 1e-6.
DIFFERENCES = 2e-5
GROUPS = ["SO3", "SE2"]


@pytest.fixture(params=GROUPS)
def loop(request, loop_with, make, controller_class):
    made = loop_with(request.param, make(controller_class))
    problems = Problems(str)
    made.controller.check(made.group, problems)
    if problems:
        pytest.skip(f"not for {request.param}")
    return made


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)], ids=str)
def test_torque_and_dissipation_have_the_batch_axes_of_the_state(loop, states, batch):
    s = loop.tracking(0.3, states(loop, batch))
    assert loop.controller.torque(s).shape == (*batch, loop.group.dimension)
    dissipation = loop.controller.dissipation(s)
    assert dissipation is None or np.shape(dissipation) == batch


def test_many_states_equal_one_by_one(loop, states):
    many = states(loop, (3,))
    together = loop.vector_field(0.3, many)
    alone = np.stack([loop.vector_field(0.3, one) for one in many])
    np.testing.assert_allclose(together, alone, rtol=0, atol=ROUNDING)


def test_batched_parameters_equal_one_by_one(loop, states):
    many, scales = states(loop, (3,)), np.array([0.5, 1.0, 1.5])
    batched = {
        name: np.stack([scale * values for scale in scales])
        for name, values in leaves(loop).items()
        if name.startswith(("controller.", "gains."))
    }
    together = with_leaves(loop, batched).vector_field(0.3, many)
    for run in range(3):
        own = {name: values[run] for name, values in batched.items()}
        alone = with_leaves(loop, own).vector_field(0.3, many[run])
        np.testing.assert_allclose(together[run], alone, rtol=0, atol=ROUNDING)


def test_dissipation_is_the_rate_at_which_l_falls(loop, states):
    y, t, h = states(loop, (4,)), 0.3, 1e-4
    dissipation = loop.controller.dissipation(loop.tracking(t, y))
    if dissipation is None:
        pytest.skip("the law does not say what it dissipates")
    rate = loop.vector_field(t, y)
    after, before = (loop.lyapunov(loop.tracking(t + d, y + d * rate)) for d in (h, -h))
    np.testing.assert_allclose(-(after - before) / (2 * h), dissipation, rtol=0, atol=DIFFERENCES)


def test_an_additional_torque_raises_l_by_its_power(loop, states):
    """At the rate ⟨δ, y⟩ of the velocity error y, which is read where the dissipation is known."""
    y, t, h = states(loop, (4,)), 0.3, 1e-4
    if loop.controller.dissipation(loop.tracking(t, y)) is None:
        pytest.skip("the law does not say what it dissipates")
    added = np.zeros_like(y)
    added[..., loop.layout.slices["momentum"]] = np.random.default_rng(5).standard_normal(
        (4, loop.group.dimension)
    )
    after, before = (loop.lyapunov(loop.tracking(t, y + d * added)) for d in (h, -h))
    error = loop.controller.velocity_error(loop.tracking(t, y))
    power = (added[..., loop.layout.slices["momentum"]] * error).sum(axis=-1)
    np.testing.assert_allclose((after - before) / (2 * h), power, rtol=0, atol=DIFFERENCES)


def test_the_gradient_of_l_by_the_memory(loop, states):
    y, t, h = states(loop, (4,)), 0.3, 1e-4
    s = loop.tracking(t, y)
    gradient = memory_gradient(loop.controller, s)
    if not s.memory or gradient is None:
        pytest.skip("the law keeps nothing, or does not say how L depends on it")
    for name, slope in gradient.items():
        moved = np.zeros_like(y)
        moved[..., loop.layout.slices[f"controller.{name}"]] = direction = np.full_like(slope, 0.7)
        after, before = (loop.lyapunov(loop.tracking(t, y + d * moved)) for d in (h, -h))
        expected = (slope * direction).sum(axis=-1)
        np.testing.assert_allclose((after - before) / (2 * h), expected, rtol=0, atol=DIFFERENCES)


def test_symbols_give_the_same_as_floats(loop, states, symbols):
    to, back = symbols
    y = states(loop, (2,))
    held = loop.holding(0.3)
    traced = with_leaves(held, {path: to(number) for path, number in leaves(held).items()})
    # Symbols are added in another order than NumPy's products.
    found = back(traced.vector_field(to(0.3), to(y)))
    np.testing.assert_allclose(found, loop.vector_field(0.3, y), rtol=0, atol=ROUNDING)


def test_structure_is_hashable_and_leaves_are_arrays(loop):
    hash(loop.controller.structure)
    assert all(isinstance(value, np.ndarray) for value in leaves(loop.controller).values())


def test_figures_and_configurations_have_a_name_for_it(controller_class):
    assert controller_class.title
    assert set(controller_class.tasks) <= {"track", "stabilise"}


def test_its_publication_is_one_entry_of_bibtex(controller_class):
    entry = controller_class.bibtex
    if not entry:
        return
    key, fields = re.fullmatch(
        r"@(?:article|book|inproceedings|misc)\{(\w+),\n(.*)\n\}", entry, re.S
    ).groups()
    names = re.findall(r"^  (\w+) += \{", fields, re.M)
    assert {"author", "title", "year"} <= set(names) and len(names) == len(set(names))
    assert entry.count("{") == entry.count("}")
    year = re.search(r"year += \{(\d{4})\}", fields)[1]
    assert year in key
    assert year in controller_class.theorem or "(" not in controller_class.theorem


def test_what_it_claims_is_yes_no_or_nothing(make, controller_class):
    assert make(controller_class).claims_decrease in (True, False, None)


def test_a_law_of_eqt_pickles(make, controller_class):
    if controller_class.__module__.startswith("eqt_plugin"):
        pytest.skip("a plugin is loaded again in a worker, and is no module that can be imported")
    law = make(controller_class)
    assert pickle.loads(pickle.dumps(law)) == law
