"""More than one machine: executors over Parsl's queues of clusters and over a Dask scheduler."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("executors", "parsl", "executors")
    extension.add_component("executors", "dask", "executors")
