"""Signals of an actuator of the user's own: run, plotted, and read without its file."""

from pathlib import Path

import numpy as np
import pytest

import eqt_cli
from eqt_cli.base.errors import ComponentError
from eqt_cli.results.result import open_result

MOTORS = '''
"""Motors about the axes, which become warm."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Actuator, Numbers, signal

HEAT = signal("motor_heat", "J", "q", dims=("motor",), words="heat of each motor")
POWER = signal("motor_power", "W", "P", words="heat that all motors give off")


@dataclass(frozen=True)
class Motors(Actuator):
    """Motors that give the torque, and become warm by its square."""

    name: ClassVar[str] = "motors"
    departs: ClassVar[str] = "motors become warm"
    moves: ClassVar[bool] = True
    members: ClassVar = {"motor": ("left", "right", "top")}
    shows: ClassVar = (HEAT, POWER)

    resistance: Numbers

    def signals(self, G, V, command, x):
        return {"motor_heat": x, "motor_power": self.state_rate(G, command, x).sum(axis=-1)}

    def states(self, G):
        return 3

    def state_rate(self, G, command, x):
        return self.resistance * command * command

    def output(self, G, command, x):
        return command
'''
CHANGES = {
    "plugins": "[motors.py]",
    "controllers": "[eqt]",
    "actuators": "[{kind: motors, resistance: 2.0}]",
    "ensemble": "{runs: 2, seed: 1}",
    "time": "{duration: 1.0, samples: 101}",
    "solver": "{engine: solve_ivp, rtol: 1.0e-8, cross_check: 0}",
}


@pytest.fixture
def warm(run, folder):
    (folder / "motors.py").write_text(MOTORS, encoding="utf-8")
    run(out="warm", **CHANGES)
    return folder / "warm"


def test_results_hold_them_and_need_no_plugin(warm):
    (warm.parent / "motors.py").unlink()
    with eqt_cli.open_result(warm) as result:
        heat, power = result["motor_heat"], result["motor_power"]
        torque, times = result["command"], result.times
        assert result.dims("motor_heat") == ("controller", "run", "time", "motor")
        assert list(result.coordinate("motor")) == ["left", "right", "top"]
        assert result.units("motor_heat") == "J"
        table = result.to_xarray()["motor_heat"].to_dataframe()
        assert table["motor_heat"].size == heat.size
    with open_result(warm) as result:
        quantity = result.quantity("motor_power")
    assert (quantity.long_name, quantity.plain) == ("heat that all motors give off", "P")
    np.testing.assert_allclose(power, 2.0 * (torque**2).sum(axis=-1), rtol=1e-12)
    # The trapezoidal rule, with an error of about h²/12 of the change of the slope.
    pieces = np.diff(times)[:, None] * (torque[:, :, 1:] ** 2 + torque[:, :, :-1] ** 2)
    np.testing.assert_allclose(heat[:, :, 1:], np.cumsum(pieces, axis=2), rtol=0, atol=3e-4)


@pytest.mark.ci("draws figures")
def test_a_figure_shows_the_members_by_name(warm, invoke):
    plot = "plot", warm, "--figure", "commands"
    assert "commands.pdf" in invoke(*plot, "--option", "signal=motor_heat").stdout
    drawn = Path(warm, "figures", "commands.svg").read_text(encoding="utf-8")
    assert drawn.count("<!-- left $") == 1
    said = invoke(*plot, "--option", "signal=motor_power", code=2).stderr
    assert "finds no signal 'motor_power' with a row for each member" in said


def test_a_name_that_results_have_is_refused(run, folder):
    taken = MOTORS.replace('"motor_power"', '"lyapunov"')
    (folder / "motors.py").write_text(taken, encoding="utf-8")
    with pytest.raises(ComponentError, match="signal of an actuator 'lyapunov': results have a"):
        run(out="warm", **CHANGES)
