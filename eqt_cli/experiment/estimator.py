"""The section `estimator`: whether what is measured is enough for it."""

from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle import Vehicle


def check_estimator(
    vehicle: Vehicle, G: MatrixLieGroup, without_clock: bool, problems: Problems
) -> None:
    """Note an estimator without a clock or without fixes, and what is wrong with it for them."""
    here, estimator = problems.at("estimator"), vehicle.estimator
    assert estimator is not None
    if without_clock:
        here.add("acts at control instants; set control.period")
    if not vehicle.pose_sensors and not problems.at("sensors"):
        here.add(
            "nothing measures the pose, so that its error grows without bound; add an entry to "
            "sensors.pose"
        )
    if vehicle.control is None or problems.at("sensors") or problems.at("control") or here:
        return
    estimator.check_sensors(vehicle.schedule(G), vehicle.deviations(G), here)
