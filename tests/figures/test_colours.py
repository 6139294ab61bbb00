"""Colours of laws for readers who see fewer colours, or none."""

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from eqt_cli.figures.shown import MOST_COLOURS
from eqt_cli.figures.style import component_style, house_style, line_style

PAPER, ALL = range(4), range(MOST_COLOURS)
"""The positions of the paper's laws, and of all that have a colour."""

# Machado, Oliveira and Fernandes (2009), severity 1, on linear RGB.
BLINDNESS = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "none": np.eye(3),
}
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.119192, 0.9503041],
    ]
)
WHITE = TO_XYZ.sum(axis=1)


def lab(position, blindness="none", style=line_style):
    """CIE L*a*b* of a law's colour, D65."""
    with house_style():
        channels = np.array(to_rgb(style(position)["color"]))
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.asarray(BLINDNESS[blindness]) @ linear, 0, 1)
    ratio = TO_XYZ @ seen / WHITE
    x, y, z = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("blindness", BLINDNESS)
def test_six_laws_differ_by_colour_alone(blindness):
    # CIE 1976, in which 2.3 is just seen; 20 is seen in a thin line.
    colours = [lab(position, blindness) for position in ALL]
    pairs = itertools.combinations(colours, 2)
    assert min(np.linalg.norm(one - other) for one, other in pairs) > 20


def test_the_papers_laws_differ_in_greyscale():
    lightness = sorted(lab(position)[0] for position in PAPER)
    assert min(np.diff(lightness)) > 9
    assert lightness[-1] < 67  # and none is too pale on white paper


def test_components_of_a_vector_have_the_colour_of_no_law():
    components = [lab(k, style=component_style) for k in range(3)]
    distances = [np.linalg.norm(one - lab(law)) for one in components for law in ALL]
    assert min(distances) > 20
