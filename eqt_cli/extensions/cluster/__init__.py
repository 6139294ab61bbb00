"""More than one machine: executors over Parsl's queues of clusters and over a Dask scheduler."""

COMPONENTS = {"executors": {"parsl": "executors", "dask": "executors"}}
