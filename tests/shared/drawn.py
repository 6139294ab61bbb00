"""Tests of properties on a few examples."""

from hypothesis import given, settings
from hypothesis import strategies as st


def drawn(examples=5, **more):
    """Try a test on examples that it draws from `data`, and of what else is drawn for it."""
    return lambda test: settings(max_examples=examples)(given(data=st.data(), **more)(test))
