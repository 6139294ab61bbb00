"""`eqt config new --from` a file of a vehicle."""

from pathlib import Path

import pytest
from case_tables import from_yaml
from vehicle_files import MOMENTS, QUAD


@pytest.fixture
def quad(folder):
    (folder / "quad.sdf").write_text(QUAD, encoding="utf-8")
    return folder


def test_it_writes_a_configuration_and_checks_it(eqt, quad):
    """Mass, moments, speed at hover √(m g/4 k) and 4 k η²/m g are told first."""
    done = eqt("config", "new", "mine.yaml", "--from", "quad.sdf", "--bandwidth", 5)
    first, mass, moments, hover, *check = done.out.splitlines()
    assert (done.code, first) == (0, "mine.yaml")
    assert mass.startswith("mass 2 kg")
    said = ", ".join(f"{moment:.4g}" for moment in sorted(MOMENTS))
    assert moments == f"principal moments {said} kg m²"
    assert hover == "hover at 700.2 rad/s, thrust to weight 2.04"
    assert check[0] == "✓ mine.yaml: valid"
    assert done.err == "next: eqt run mine.yaml\n"


def test_it_is_named_after_the_file(eqt, quad):
    assert eqt("config", "new", "--from", "quad.sdf", "--bandwidth", 5, "-q").code == 0
    assert Path("quad.yaml").is_file()


@from_yaml
def test_it_refuses(refused, quad, arguments, said):
    message = refused("config", "new", "mine.yaml", *arguments.split())
    for word in said:
        assert word in message
    assert not Path("mine.yaml").exists()


@pytest.mark.ci("flies two vehicles for 12 s")
@pytest.mark.parametrize("options", [[], ["--thrust=0,8"]])
def test_it_hovers(eqt, quad, options):
    """The error left after 12 s of poles at −1 rad/s: 1e-5 of the start, and drag slows it."""
    import eqt_cli

    eqt("config", "new", "mine.yaml", "--from", "quad.sdf", "--bandwidth", 5, "-q", *options)
    result = eqt_cli.run("mine.yaml")
    assert float(result["final_position_error"].max()) < 2e-3
