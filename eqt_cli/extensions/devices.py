"""Integration on a device through OpenCL: the engine's own C, one run a work item.

A run has the same bits as on the CPU. Before the first use of a driver, 64 runs are integrated on
both and compared.
"""

from __future__ import annotations

import os
import re
import threading
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from eqt_cli.base.arrays import FUNCTIONS, Array, apply, cos, less, sin, where
from eqt_cli.base.errors import EqtError, EqtWarning, InputError, Remedy
from eqt_cli.base.reporting import reporter, subject
from eqt_cli.engines import library
from eqt_cli.engines.compiler import digest, user_cache
from eqt_cli.engines.library import Measuring, SampleProgram
from eqt_cli.numbers.program import Program, traced

NEEDED = {
    "FMA": "fused multiply-add",
    "DENORM": "subnormal numbers",
    "INF_NAN": "infinities and NaN",
    "ROUND_TO_NEAREST": "rounding to nearest",
}
"""What doubles of a device must have. Their + - * / and roots are rounded correctly by OpenCL."""

SHARE = 0.5
"""Largest share of a device's memory that is used at a time."""

TEST_RUNS = 64

INSIDE = tuple(name for name in FUNCTIONS if name != "acosh")
"""Functions that are defined between 0 and 1."""


@dataclass(frozen=True)
class Device:
    """An OpenCL device.

    Attributes
    ----------
    number
        Its number among the devices of this machine, from 0.
    name, driver
        Its name, and the name and version of its driver.
    memory, largest
        Bytes of its memory, and of the largest array in it.
    lacks
        What eqt needs and it does not have.
    """

    number: int
    name: str
    driver: str
    memory: int
    largest: int
    lacks: tuple[str, ...]
    opencl: Any = field(compare=False, repr=False)

    @property
    def described(self) -> str:
        """Number, name and driver in a line."""
        return f"opencl:{self.number} ({self.name}, {self.driver})"

    @property
    def tested(self) -> str:
        """What provenance says of the device."""
        return f"{self.described}, tested with {TEST_RUNS} runs"

    def integration(
        self, field: Program, at_samples: SampleProgram | None = None
    ) -> library.Advance:
        """Return the kernel of a field on this device; see `integration`."""
        return integration(field, self, at_samples)


def _opencl() -> Any:
    # The cache of the package holds pickled objects; drivers have caches of their own.
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
    try:
        import pyopencl
    except ImportError as error:
        raise InputError(
            "a device needs pyopencl (extra opencl): pip install 'pyopencl[pocl]'; or use the "
            "device cpu"
        ) from error
    return pyopencl


@lru_cache(maxsize=1)
def devices() -> tuple[Device, ...]:
    """Return the OpenCL devices of this machine.

    Raises
    ------
    InputError
        If the package pyopencl is not installed.
    """
    cl = _opencl()
    try:
        all_devices = [each for platform in cl.get_platforms() for each in platform.get_devices()]
    except cl.Error:  # no driver is installed
        return ()
    return tuple(_device(cl, number, each) for number, each in enumerate(all_devices))


def _device(cl: Any, number: int, each: Any) -> Device:
    does = each.double_fp_config if "cl_khr_fp64" in each.extensions.split() else 0
    absent = [
        what for name, what in NEEDED.items() if not does & getattr(cl.device_fp_config, name)
    ]
    return Device(
        number,
        each.name.strip(),
        f"{each.platform.name.strip()} {each.driver_version.strip()}",
        each.global_mem_size,
        each.max_mem_alloc_size,
        tuple(absent) if does else ("double precision",),
        each,
    )


def chosen(text: str) -> Device:
    """Return the device of an option.

    Raises
    ------
    InputError
        If there is no such device, or it does not compute as IEEE 754 requires.
    """
    match = re.fullmatch(r"opencl(?::(\d{1,4}))?", text)
    if match is None:
        raise InputError(f"expected cpu, opencl or opencl:NUMBER, got '{text}'")
    all_devices = devices()
    if match[1] is None:
        device = next((each for each in all_devices if not each.lacks), None)
    else:
        device = all_devices[int(match[1])] if int(match[1]) < len(all_devices) else None
    if device is None:
        raise InputError(
            f"there is no device {text} with double precision; `eqt list devices` names those of "
            "this machine. A GPU needs the OpenCL driver of its maker; 'pip install "
            "pocl-binary-distribution' computes on the CPU"
        )
    if device.lacks:
        raise InputError(f"{device.described} lacks {', '.join(device.lacks)}; use another device")
    return device


# Kernels ------------------------------------------------------------------------------------------

_ARRAYS = (
    *("grid", "held", "parameters", "states", "samples", "steps", "counts", "ends", "times"),
    *("rows", "places", "starts", "memory", "kept"),
)
"""The arrays of ``eqt_runs``, in the order of kernel.h."""

_lock = threading.RLock()  # the test of a driver runs a kernel within it


@lru_cache(maxsize=32)
def integration(
    field: Program, device: Device, at_samples: SampleProgram | None = None
) -> library.Advance:
    """Return the kernel of a field on a device that passed its test.

    A kernel that the driver cannot build runs on the CPU, with a remark.

    Raises
    ------
    EqtError
        If the device has other bits than the CPU.
    """
    with _lock:
        _test(device)
        with reporter().busy(f"compiling {subject()} for {device.described}"):
            try:
                return Kernel(device, library.kernel_source(field, at_samples))
            except _opencl().Error as error:
                states = dict(field.inputs)["state"]
                reporter().remark(
                    EqtWarning(
                        f"{device.described} cannot hold a law of {states} states and "
                        f"{len(field.values)} operations, which runs on the CPU: "
                        f"{_reason(error)}"
                    )
                )
                return library.integration(field, at_samples)


def _reason(error: Exception) -> str:
    """Return the first line of what a driver says."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


class Kernel:
    """``eqt_runs`` of a field on a device; a call does what that of `library.integration` does.

    Parameters
    ----------
    code
        The source, in OpenCL C.
    """

    def __init__(self, device: Device, code: str) -> None:
        self.device, cl = device, _opencl()
        self._context = cl.Context([device.opencl])
        self._queue = cl.CommandQueue(self._context)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cl.CompilerWarning)
            built = cl.Program(self._context, code).build("-cl-std=CL1.2 -w")
        self._runs = cl.Kernel(built, "eqt_runs")

    def __call__(self, measuring: Measuring | None, **values: Any) -> None:
        """Integrate runs, as many at a time as the device has memory for."""
        names = ["parameters", "states", "steps", "counts", "ends", "times"]
        arrays: dict[str, Array] = {name: values[name] for name in names}
        rows: list[library.Rows] = []
        if measuring is None:
            arrays["samples"] = values["samples"]
        else:
            arrays |= {"memory": measuring.memory, "kept": measuring.stored}
            rows = list(measuring.rows)
        by_run = [*arrays.values(), *(row.values for row in rows if row.by_run)]
        sizes = [array[0].nbytes for array in by_run] if values["runs"] else [1]
        most = min(SHARE * self.device.memory / sum(sizes), self.device.largest / max(sizes))
        with _lock:
            for start in range(0, values["runs"], max(1, int(most))):
                runs = slice(start, start + max(1, int(most)))
                here = {name: array[runs] for name, array in arrays.items()}
                try:
                    self._integrate(here, [row.of(runs) for row in rows], measuring, values)
                except _opencl().Error as error:  # too few registers, or memory
                    raise EqtError(
                        f"{self.device.described} cannot integrate {len(here['states'])} runs of "
                        f"{values['states'].shape[1]} states: {_reason(error)}",
                        Remedy("use the device cpu"),
                    ) from error

    def _integrate(
        self,
        arrays: Mapping[str, Array],
        rows: list[library.Rows],
        measuring: Measuring | None,
        values: Mapping[str, Any],
    ) -> None:
        """Integrate some runs, whose arrays are changed in place."""
        cl = _opencl()
        rows_flat, places, behind = [np.empty(0)], [], 0
        for row in rows:
            along = row.length if row.by_sample else 0
            per_run = row.values[0].size if row.by_run else 0
            places += [behind, per_run, along]
            rows_flat.append(np.ravel(row.values))
            behind += row.values.size
        data = dict(arrays)
        data |= {"grid": values["grid"], "held": values["held"], "rows": np.concatenate(rows_flat)}
        data["places"] = np.array(places, dtype=np.int64)
        if measuring is not None:
            data["starts"] = measuring.starts
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        hosts = {name: np.ascontiguousarray(array) for name, array in data.items()}
        buffers = {
            name: cl.Buffer(self._context, flags, hostbuf=array)
            for name, array in hosts.items()
            if array.size
        }
        counts = [np.int64(values[name]) for name in ("later", "most_steps")]
        numbers = [np.float64(values[name]) for name in library.SPAN_NUMBERS]
        order = [buffers.get(name) for name in _ARRAYS]
        runs = len(hosts["states"])
        self._runs(self._queue, (runs,), None, *counts, *numbers, *order)
        for name in ("states", "samples", "steps", "counts", "ends", "times", "memory", "kept"):
            if name in buffers:
                cl.enqueue_copy(self._queue, hosts[name], buffers[name])
                arrays[name][...] = hosts[name]


# The test of a driver -----------------------------------------------------------------------------


@lru_cache(maxsize=8)
def _test(device: Device) -> None:
    """Compare the bits of some runs with the CPU's, once for a driver.

    Raises
    ------
    EqtError
        If they differ.
    """
    field = traced(_every_function, {"state": 3, "time": 1, "parameters": 1, "held": 1})
    code = library.kernel_source(field)
    cache, key = user_cache(), digest("\0".join([device.described, code]))
    if cache is not None and cache.find(key, ".txt"):
        return
    try:
        kernel = Kernel(device, code)
    except _opencl().Error as error:
        raise EqtError(
            f"{device.described} cannot build the test kernel: {_reason(error)}",
            Remedy("use the device cpu, or another driver"),
        ) from error
    results = [_tested(function) for function in (kernel, library.integration(field))]
    if results[0] != results[1]:
        raise EqtError(
            f"{device.described} does not give the bits of the CPU in {TEST_RUNS} test runs",
            Remedy("use the device cpu, or another driver"),
        )
    if cache is not None:
        cache.keep(key, ".txt", b"passed")


def _every_function(inputs: dict[str, Array]) -> Mapping[str, Array]:
    """Return a bounded field in which every elementary function, a quotient and a choice act."""
    x, y, z = np.split(inputs["state"], 3)
    mixed = sum(apply(name, 0.5 + 0.4 * sin(x + shift)) for shift, name in enumerate(INSIDE))
    mixed = mixed + apply("acosh", 2.5 + sin(y)) + sin(1e9 * z)
    turned = where(less(x, y), z, -z / (1.0 + y * y))
    return {
        "derivative": np.concatenate(
            [turned, inputs["parameters"] * sin(mixed), cos(inputs["time"]) - z]
        )
    }


def _tested(function: Any) -> list[bytes]:
    """Return the bytes of all that a function gives for the runs of the test."""
    runs, times = TEST_RUNS, np.linspace(0.1, 1.0, 10)
    states = np.linspace(-3.0, 3.0, 3 * runs).reshape(runs, 3)
    whole, numbers = np.zeros((2, runs), dtype=np.int64), np.zeros((2, runs))
    samples = np.zeros((runs, len(times), 3))
    function(
        None,
        runs=runs,
        later=len(times),
        most_steps=10_000,
        to_next_run=samples[0].size,
        start=0.0,
        stop=1.0,
        first_inside=0.0,
        last_inside=1.0,
        rtol=1e-10,
        atol=1e-10,
        longest=1.0,
        grid=times,
        held=np.zeros(1),
        parameters=np.linspace(0.5, 1.5, runs)[:, None],
        states=states,
        samples=samples,
        steps=numbers[0],
        counts=whole[0],
        ends=whole[1],
        times=numbers[1],
    )
    return [each.tobytes() for each in (states, samples, numbers, whole)]
