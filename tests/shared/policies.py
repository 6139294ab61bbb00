"""Experiments in which a policy is trained."""

from small_experiment import mapping

POLICY = {
    "kind": "network",
    "label": "policy",
    "observes": [{"signal": "rotation_error"}, {"signal": "rates"}, {"signal": "last_command"}],
    "commands": {"as": "wrench", "scale": 0.05},
}


def attitude(**changes):
    """An attitude with all that is drawn, for a fifth of a second."""
    return (
        mapping(
            inertia=[0.02, 0.02, 0.04],
            rigid=False,
            reference={"torque": ["0.01*cos(5*t)", "0.01*sin(3*t)", "0"]},
            plant={"inertia": [{"uniform": [0.015, 0.025]}, 0.02, 0.04]},
            controllers=[POLICY],
            actuators=[{"kind": "limit", "limit": 0.04}, {"kind": "lag", "time_constant": "20 ms"}],
            control={"period": "10 ms", "delay": 1},
            sensors={
                "pose": [{"kind": "noise", "std": 0.01}],
                "velocity": [
                    {"kind": "bias", "value": {"normal": [0, 0.1]}, "walk": "0.1 rad/s/sqrt(s)"}
                ],
            },
            time={"duration": 0.2, "samples": 21},
            solver={"engine": "native", "cross_check": 0},
        )
        | changes
    )
