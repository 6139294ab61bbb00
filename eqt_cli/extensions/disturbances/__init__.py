"""Disturbances of benchmarks: wind with the spectrum of Dryden, and payloads."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("forces", "dryden", "dryden")
    extension.add_component("forces", "payload", "payload")
