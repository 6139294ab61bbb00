"""What is said of thrusters that will not do: each mistake with its place."""

from case_tables import from_yaml
from mistakes import said_of
from said import says


@from_yaml
def test_what_is_wrong_is_said_once_and_at_its_place(experiment, group, sections, said):
    assert says(said_of(experiment, group, sections), said)
