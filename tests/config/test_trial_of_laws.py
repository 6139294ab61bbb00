"""Mistakes in a user's components are found when the configuration is checked, with their line."""

from pathlib import Path

import pytest
from case_tables import from_yaml
from plugin_sources import component

from eqt_cli.base.errors import ComponentError

LAW = component("""
import numpy as np
own(eqt_cli.components.laws.Controller):
    title: ClassVar[str] = "Own"

    def torque(self, s):
        return BODY

    def dissipation(self, s):
        return LOSS
""")
REFERENCE = component("""
own(eqt_cli.components.references.Reference):
    def driving_torque(self, G, inertia, t, Pd):
        return BODY
""")
GROUP = """\
from typing import ClassVar

from eqt_cli.components.matrix_groups import SO3


class Own(SO3):
    name: ClassVar[str] = "Own"

    def hat(self, v):
        return BODY
"""
ENGINES = ("solve_ivp", "native")


def law(body, loss="None"):
    Path("own.py").write_text(LAW.replace("BODY", body).replace("LOSS", loss), encoding="utf-8")
    return {"plugins": "[own.py]", "controllers": "[eqt, own]"}


@pytest.mark.parametrize("engine", ENGINES)
@from_yaml
def test_a_law_that_raises(message, engine, body, said):
    text = message(f"solver.engine={engine}", **law(body))
    where, _, rest = text.partition(": controllers[1]: ")
    assert where.startswith("c.yaml:")
    assert rest == f"controller 'own' {said} at own.py:12: return {body}"


@from_yaml
def test_a_law_of_another_shape(message, body, found):
    found = found or ("an array of shape (6, 3) for 5 runs of 6 samples; expected (5, 6, 3)")
    assert message(**law(body)).partition(": controllers[1]: ")[2] == (
        f"controller 'own' is wrong at the start of run 0: own.py:11: torque returns {found}"
    )


def test_a_dissipation_of_another_shape(message):
    assert message(**law("-s.V", "s.V")).partition(": controllers[1]: ")[2] == (
        "controller 'own' is wrong at the start of run 0: own.py:14: dissipation returns an array "
        "of shape (5, 3) for 5 runs; expected (5,)"
    )


@from_yaml
def test_a_reference(message, body, said):
    Path("own.py").write_text(REFERENCE.replace("BODY", body), encoding="utf-8")
    text = message(plugins="[own.py]", reference="{kind: own}")
    assert text.partition(": reference: ")[2] == f"reference 'own' {said}"


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("v.foo", "AttributeError: 'numpy.ndarray' object has no attribute 'foo' at own.py:10: "),
        ("v", "ValueError: matmul: "),
    ],
)
def test_a_group(message, body, said):
    Path("own.py").write_text(GROUP.replace("BODY", body), encoding="utf-8")
    text = message(plugins="[own.py]", group="Own", controllers="[eqt]")
    found = text.partition(": group: ")[2]
    assert found.startswith(f"group 'Own' fails at the start of run 0: {said}")


def test_a_law_that_fails_later_is_named_too(run):
    body = "-s.V if np.max(s.t) < 0.5 else 1 / 0"
    with pytest.raises(ComponentError) as caught:
        run("solver.engine=solve_ivp", **law(body))
    assert str(caught.value) == (f"ZeroDivisionError: division by zero at own.py:12: return {body}")


def test_a_law_that_is_right(run):
    assert run(**law("-s.V", "0.0")).failed == 0
