"""`eqt config new --vehicle`: a first configuration from some numbers."""

import pytest
from case_tables import from_yaml, in_ci
from said import says

VEHICLES = {
    "quadrotor --mass 0.5 --inertia 3.65e-3,3.68e-3,7.03e-3 --bandwidth 10": [
        "cascade ωx, ωy, ωz 10 1",
        "cascade x, y, z 2 1",
    ],
    "satellite --inertia 6,4,7 --bandwidth 0.2": ["Lee 2010, Bullo–Murray ωx, ωy, ωz 0.2 1"],
    "satellite --inertia 6,0.5,-0.4,4,0.3,7 --bandwidth 0.2": [
        "Lee 2010, Bullo–Murray ωx, ωy, ωz 0.2 1"
    ],
    "quadrotor --mass 0.5 --inertia 4e-3,-1e-3,0,4e-3,0,7e-3 --bandwidth 10": [
        "cascade ωx, ωy, ωz 10 1",
        "cascade x, y, z 2 1",
    ],
    "auv --mass 11.5 --inertia 0.16,0.16,0.2 --bandwidth 1.5": [
        "EqT, GT ωx, ωy, ωz, vx, vy, vz 1.5 1"
    ],
    "boat --mass 80 --inertia 20 --bandwidth 0.5": ["EqT, GT ω, vx, vy 0.5 1"],
}


BRIEF = [f"{' '.join(vehicle.split()[::2])[:40]}" for vehicle in VEHICLES]


@pytest.mark.needs("proofs")
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("vehicle", "gains"),
    [in_ci("another one is fast", *case, unless="4e-3" in case[0]) for case in VEHICLES.items()],
    ids=BRIEF,
)
def test_it_has_the_bandwidth_that_was_given(eqt, vehicle, gains):
    """Bandwidth and damping of each axis, from the linearised loop."""
    eqt("config", "new", "mine.yaml", "--vehicle", *vehicle.split())
    done = eqt("config", "check", "mine.yaml")
    assert (done.code, done.err) == (0, "")
    lines = [" ".join(line.split()) for line in done.out.splitlines()]
    begin = lines.index("law axis bandwidth, rad/s damping") + 2
    assert lines[0] == "✓ mine.yaml: valid"
    assert lines[begin : begin + len(gains) + 1] == [*gains, ""]
    assert lines[-1].endswith(" at all times")  # also where a slew ends


@from_yaml
def test_it_refuses(refused, folder, arguments, said):
    assert says(refused("config", "new", "mine.yaml", *arguments.split()), f"{said}\n")
    assert not (folder / "mine.yaml").exists()
