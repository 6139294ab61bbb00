"""Repeats the studies of docs/experiments/flown.md: ``python -m benchmarks.flights DATA``.

DATA has the folders of the repositories that the modules name. Predictions are compared with those
that were written before, in ``predictions``; without a file there, they are written, and no flight
is looked at.
"""

import argparse
import tempfile
from pathlib import Path

import yaml

import eqt_cli
from benchmarks.flights import crazyflie

HERE = Path(__file__).parent
STUDIES = {"crazyflie": crazyflie}


def main() -> None:
    """Run the studies."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", choices=STUDIES)
    options = parser.parse_args()
    for study, module in STUDIES.items():
        if options.only not in (None, study):
            continue
        with tempfile.TemporaryDirectory() as folder:
            for name, (flights, changes) in module.write_lists(options.data, Path(folder)).items():
                model = yaml.safe_load((HERE / f"{study}.yaml").read_text()) | changes
                predictions = HERE / "predictions" / f"{name}.csv"
                outcome = eqt_cli.validate(flights, model, predictions=predictions)
                print(f"\n{name}: {module.SOURCE}")
                print(outcome.text if outcome else f"wrote {predictions}", flush=True)


if __name__ == "__main__":
    main()
