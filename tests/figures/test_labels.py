"""Symbols, units and free text as Matplotlib typesets them."""

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.mathtext import MathTextParser

from eqt_cli.figures.labels import component, free_text, notation, quantity
from eqt_cli.figures.style import sentence
from eqt_cli.results.metrics import QUANTITIES


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("", "$L$"),
        ("1", "$L$"),
        ("mixed", "$L$ (mixed units)"),
        ("N m", r"$L$ $(\mathrm{N\,m})$"),
        ("m/s^2", r"$L$ $(\mathrm{m/s^{2}})$"),
        ("m s^-2", r"$L$ $(\mathrm{m\,s^{-2}})$"),
        ("(N m)^2 s", r"$L$ $[\mathrm{(N\,m)^{2}\,s}]$"),
        ("µm", "$L$ (µm)"),
        ("US$", r"$L$ (US\$)"),
        ("m^", "$L$ (m^)"),
    ],
)
def test_units_are_upright(unit, expected):
    label = quantity("L", unit)
    assert label == expected
    MathTextParser("path").parse(label)


def test_every_symbol_can_be_typeset():
    for named in QUANTITIES.values():
        for latex, plain in (named.symbol, named.formula):
            MathTextParser("path").parse(f"${latex}$" if latex else "")
            assert not set(plain.replace("{}", "")) & set(r"\{}$^-")


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ("ωx", r"\tau_{\omega x}"),
        ("x_1", r"\tau_{x 1}"),
        ("ά", r"\tau_{ά}"),
        ("-", r"\tau"),
        ("ωx₁", r"\tau_{\omega x,1}"),
        ("v3₁₀", r"\tau_{v 3,1 0}"),
        ("Ω²", r"\tau_{\Omega^{2}}"),
        ("Λ", r"\tau_{\Lambda}"),
        ("Α", r"\tau_{A}"),
    ],
)
def test_axes_are_indices(axis, expected):
    label = component(r"\tau", axis)
    assert label == expected
    MathTextParser("path").parse(f"${label}$")


@pytest.mark.parametrize("letter", [chr(code) for code in range(ord("α"), ord("ω") + 1)])
def test_every_greek_letter_can_be_an_axis(letter):
    assert unicodedata.category(letter) == "Ll"
    MathTextParser("path").parse(f"${component('P', letter)}$")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("my_law <0.5>", "my_law <0.5>"),
        ("$g = 1/2$", "$g = 1/2$"),
        (r"$\oops$", r"\$\oops\$"),
        ("$5", r"\$5"),
        ("tab\tand\x01bell", "tab and bell"),
        ("one two three", "one two\nthree"),
    ],
)
def test_free_text_is_mathematics_only_if_it_can_be(name, expected):
    assert free_text(name, 12) == expected


def test_letters_that_mathematics_lacks_are_no_matter_in_words(caplog):
    assert free_text("Q_d⁻¹: 𝕀_t", 12) == "Q_d⁻¹: 𝕀_t"
    assert not caplog.records


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("10–90 % of a_b & #1", r"10–90 \% of a\_b \& \#1"),
        (r"\input{x}", r"\textbackslash{}input\{x\}"),
        ("~^^41", r"\textasciitilde{}\textasciicircum{}\textasciicircum{}41"),
        ("<a|b>", r"\textless{}a\textbar{}b\textgreater{}"),
        ("a--b, `c'", r"a--b, \textasciigrave{}c'"),
        (r'"\$5"', r"\textquotedbl{}\$5\textquotedbl{}"),
        (r"cost \$5", r"cost \$5"),
        ("ω‖x₁", r"\ensuremath{\omega}\ensuremath{\|}x\ensuremath{{}_{1}}"),
        ("e\u0301", "é"),
        (r"$g = \frac{1}{2}$ & 5 %", r"$g = \frac{1}{2}$ \& 5 \%"),
        (r"$ω \leq 1$", r"${\omega} \leq 1$"),
    ],
)
def test_captions_have_commands_in_mathematics_only(name, expected):
    assert sentence(name) == expected


@given(st.text())
def test_free_text_can_always_be_typeset(name):
    MathTextParser("path").parse(free_text(name, 20))


def test_symbols_of_the_reference_are_typeset_among_words():
    assert notation("τ_d jumps by 1, V_d") == (r"$\tau_{\mathrm{d}}$ jumps by 1, $V_{\mathrm{d}}$")
