"""The results that tests of figures draw."""

from tests.figures.conftest import (  # noqa: F401
    _open,
    _pictures,
    altered,
    curve_names,
    opened,
    picture,
    se3,
    simulate,
    simulated_once,
    so3,
)
