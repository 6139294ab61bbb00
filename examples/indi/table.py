"""Prints errors, torque and time at limits of INDI and geometric laws, as Markdown.

`python table.py` takes about three minutes of a core; `python table.py attitude nominal gusts`
makes some of the rows.
"""

import sys
from pathlib import Path

import numpy as np
import yaml

import eqt_cli

HERE = Path(__file__).parent
PUSH = [0.2, -0.2, 0.25]
GUST = {"kind": "gust", "std": [0.15, 0.15, 0.15], "time_constant": 0.3}
TORQUE = {"kind": "constant", "force": PUSH}
LAG = {"kind": "lag", "time_constant": "50 ms"}
LIMIT = {"kind": "limit", "limit": 3}
NOISE = {"pose": 0.02, "velocity": 0.05}


def sensors(noise, **more):
    """Sensors with these standard deviations."""
    return {name: [{"kind": "noise", "std": std}] for name, std in (noise | more).items()}


ATTITUDE = {
    "nominal": {},
    "inertia +50 %": {"plant": {"inertia": {"relative": 0.5}}},
    "inertia −50 %": {"plant": {"inertia": {"relative": -0.5}}},
    "effectiveness 2": {"actuators": [LIMIT, LAG, {"kind": "scale", "factor": 2}]},
    "effectiveness ½": {"actuators": [LIMIT, LAG, {"kind": "scale", "factor": 0.5}]},
    "constant torque": {"plant": {"forces": [TORQUE]}},
    "gusts": {"plant": {"forces": [GUST]}},
    "torque, gusts, +50 %": {"plant": {"forces": [TORQUE, GUST], "inertia": {"relative": 0.5}}},
    "gusts, noise × 10": {"plant": {"forces": [GUST]}, "sensors": sensors(NOISE)},
    "gusts, lag 100 ms, 50 believed": {
        "plant": {"forces": [GUST]},
        "actuators": [LIMIT, LAG | {"time_constant": "100 ms"}],
        "lag": 0.05,
    },
    "gusts, dead time 10 ms": {
        "plant": {"forces": [GUST]},
        "control": {"period": "2 ms", "delay": "10 ms"},
    },
    "gusts, 50 Hz": {
        "plant": {"forces": [GUST]},
        "control": {"period": "20 ms"},
        "cutoff": 10,
        "rate": 40,
    },
    "gusts, 50 Hz, dead time 20 ms": {
        "plant": {"forces": [GUST]},
        "control": {"period": "20 ms", "delay": 1},
        "cutoff": 10,
        "rate": 40,
    },
}
"""Changes of attitude.yaml; `lag`, `cutoff` and `rate` are those of all laws that have them."""
ATTITUDE["the same, lag 90 ms believed"] = ATTITUDE["gusts, 50 Hz, dead time 20 ms"] | {"lag": 0.09}

WEIGHT = {"kind": "restoring", "weight": 28.93}
STILL = {"pose": 0.001, "velocity": 0.005, "accelerometer": 0.05}
HEXAROTOR = {
    "nominal": {},
    "rotors twice as strong": {"strong": 2},
    "side load 5 N": {
        "plant": {
            "forces": [
                WEIGHT,
                {"kind": "constant", "force": [0, 0, 0, 5, 0, 0], "frame": "spatial"},
            ]
        }
    },
    "mass, inertia +30 %": {
        "plant": {"forces": [{"kind": "restoring", "weight": 37.61}], "inertia": {"relative": 0.3}}
    },
    "accelerometer bias 0.3 m/s²": {
        "sensors": sensors(STILL)
        | {"accelerometer": [{"kind": "noise", "std": 0.05}, {"kind": "bias", "value": 0.3}]}
    },
    "gusts 1 N, 0.05 N m": {
        "plant": {
            "forces": [
                WEIGHT,
                {"kind": "gust", "std": [*[0.05] * 3, *[1.0] * 3], "time_constant": 0.3},
            ]
        }
    },
    "50 Hz": {"control": {"period": "20 ms"}, "cutoff": 10, "rate": 40},
    "50 Hz, dead time 20 ms": {
        "control": {"period": "20 ms", "delay": 1},
        "cutoff": 10,
        "rate": 40,
    },
}
HEXAROTOR["the same, lag 80 ms believed"] = HEXAROTOR["50 Hz, dead time 20 ms"] | {"lag": 0.08}


def changed(config, changes):
    """The configuration with the changes of a case."""
    changes = dict(changes)
    options = {name: changes.pop(name) for name in ("lag", "cutoff", "rate") if name in changes}
    if factor := changes.pop("strong", None):  # behind the limits and the lag
        config = config | {"actuators": [*config["actuators"], {"kind": "scale", "factor": factor}]}
    laws = []
    for law in config["controllers"]:
        if isinstance(law, dict) and law["kind"] in ("indi", "observer"):
            wanted = {"lag", "cutoff" if law["kind"] == "indi" else "rate"}
            law = law | {name: x for name, x in options.items() if name in wanted}
        laws.append(law)
    return config | changes | {"controllers": laws}


def root_mean_square(values):
    """Over runs and the second half of the time; NaN counts as a lost run and is left out."""
    return float(np.sqrt(np.nanmean(np.square(values[:, values.shape[1] // 2 :]))))


def cells(config):
    """For each law: error, torque and share of time at limits, as text."""
    stored = eqt_cli.run(config, HERE / "results" / config["name"], force=True)
    found = {}
    with eqt_cli.open_result(stored) as result:
        for law in result.labels:

            def read(name, law=law):
                return np.asarray(result.read(name, controller=law))

            angle = root_mean_square(read("attitude_angle"))
            text = f"{angle:.3g}°"
            if config["group"] == "SE3":
                text = f"{1e3 * root_mean_square(read('position_error')):.3g} mm, {text}"
            else:
                text += f", {root_mean_square(read('torque_norm')):.2f}"
            share = float(np.mean(read("cut_share")))
            lost = int(np.sum(read("status") != 0))
            text += f", {100 * share:.0f} %" if share > 0.005 else ""
            found[law] = text + (f", {lost} lost" if lost else "")
    return found


def main(words):
    """Print a table for each body, a row for each case."""
    for name, cases in (("attitude", ATTITUDE), ("hexarotor", HEXAROTOR)):
        config = yaml.safe_load((HERE / f"{name}.yaml").read_text(encoding="utf-8"))
        if words and name not in words:
            continue
        header = None
        for case, changes in cases.items():
            if len(words) > 1 and case not in words:
                continue
            row = cells(changed(config, changes))
            if header is None:
                header = list(row)
                print("| case | " + " | ".join(header) + " |\n" + "|---" * (len(header) + 1) + "|")
            print(f"| {case} | " + " | ".join(row.values()) + " |", flush=True)
        print()


if __name__ == "__main__":
    main(sys.argv[1:])
