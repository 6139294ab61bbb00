"""Devices: the bits of the CPU, by PoCL, which computes on the CPU through OpenCL."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
from case_tables import from_yaml, refusal

import eqt_cli
from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.engines import library
from eqt_cli.extensions import devices

CONFIGS = Path(__file__).parents[2] / "configs"
FEW = {"ensemble.runs": 5, "solver.engine": "native", "solver.cross_check": 0}

needs_device = pytest.mark.skipif(
    not find_spec("pyopencl") or not any(not each.lacks for each in devices.devices()),
    reason="no OpenCL device with double precision",
)

CASES = {
    "the paper": ("paper.yaml", {"time.duration": 5}),
    "metrics only": ("paper.yaml", {"time.duration": 5, "store.trajectories": "none"}),
    "SE(3)": ("se3.yaml", {"time.duration": 2}),
    "a law that switches": ("paper.yaml",
        {"time.duration": 3, "actuators": [{"kind": "limit", "limit": 1.5}]}),
    "a sampled loop with noise and an estimator":
        ("satellite_estimated.yaml", {"time.duration": 4}),
    "a cascade": ("quadrotor_lee.yaml", {"time.duration": 2}),
}  # fmt: skip


def _datasets(path: Path) -> dict[str, Any]:
    found = {}
    with h5py.File(path / "results.h5") as file:
        file.visititems(
            lambda name, each: (
                found.update({name: each[()].tobytes()})
                if isinstance(each, h5py.Dataset) and each.dtype != object
                else None
            )
        )
    return found


def test_a_device_is_one_of_the_numbers_from_0(monkeypatch: pytest.MonkeyPatch) -> None:
    fine: Any = SimpleNamespace(lacks=())
    poor: Any = SimpleNamespace(lacks=("double precision",), described="a device")
    monkeypatch.setattr(devices, "devices", lambda: (poor, fine))
    assert devices.chosen("opencl") is devices.chosen("opencl:1") is fine
    assert "there is no device opencl:2" in refusal(InputError, devices.chosen, "opencl:2")
    assert "lacks double precision" in refusal(InputError, devices.chosen, "opencl:0")


def test_the_field_by_which_a_device_is_tested_is_defined_everywhere() -> None:
    """Every function is finite at each of three states, whatever their values."""
    field = devices._every_function(
        {
            "state": np.linspace(-1e3, 1e3, 3000),
            "parameters": np.array([0.5]),
            "time": np.array([0.25]),
        }
    )["derivative"]
    x, y, z = np.split(np.linspace(-1e3, 1e3, 3000), 3)
    assert len(field) == 3000
    np.testing.assert_array_equal(field[:1000], np.where(x < y, z, -z / (1 + y * y)))
    np.testing.assert_array_equal(field[2000:], np.cos(0.25) - z)
    assert np.isfinite(field).all()


@needs_device
@pytest.mark.ci("drivers compile each law for 1 to 3 s")
@pytest.mark.parametrize("case", CASES)
def test_a_device_gives_the_bits_of_the_cpu(case: str, tmp_path: Path) -> None:
    name, changes = CASES[case]
    found = []
    for device in ("cpu", "opencl"):
        given = {**FEW, **changes, "solver.device": device}
        eqt_cli.run(eqt_cli.load_experiment(CONFIGS / name, given), out=tmp_path / device)
        found.append(_datasets(tmp_path / device))
    assert len(found[0]) > 10
    assert found[0] == found[1]


def test_a_device_that_cannot_build_the_test_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    cl = pytest.importorskip("pyopencl")

    def broken(device: Any, code: str) -> Any:
        raise cl.RuntimeError("clBuildProgram failed: OUT_OF_HOST_MEMORY\nlines of a compiler")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(devices, "Kernel", broken)
    device = devices.Device(0, "card", "driver 1", 1, 1, (), None)
    devices._test.cache_clear()
    said = refusal(EqtError, devices._test, device)
    assert said.startswith(
        "opencl:0 (card, driver 1) cannot build the test kernel: clBuildProgram failed: "
        "OUT_OF_HOST_MEMORY"
    )
    devices._test.cache_clear()


@needs_device
@pytest.mark.ci("compiles a loop with every elementary function")
def test_the_test_of_a_driver_compares_64_runs_with_the_cpu(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    device = devices.chosen("opencl")
    assert device is not None
    monkeypatch.setattr(devices, "Kernel", lambda device, code: _wrong)
    devices._test.cache_clear()
    field = devices.traced(
        devices._every_function, {"state": 3, "time": 1, "parameters": 1, "held": 1}
    )
    assert refusal(EqtError, devices.integration, field, device).startswith(
        f"{device.described} does not give the bits of the CPU in 64 test runs"
    )
    devices._test.cache_clear()


def _wrong(measuring: None, **values: Any) -> None:
    """Change the last bit of one number of one run."""
    field = devices.traced(
        devices._every_function, {"state": 3, "time": 1, "parameters": 1, "held": 1}
    )
    library.integration(field)(measuring, **values)
    values["states"][-1, -1] = np.nextafter(values["states"][-1, -1], np.inf)


def test_runs_are_cut_into_batches_that_fit_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    device = devices.Device(
        0, "a", "b", memory=2 * 3 * 8 * 10, largest=10**9, lacks=(), opencl=None
    )
    kernel = devices.Kernel.__new__(devices.Kernel)
    kernel.device = device
    sizes: list[int] = []
    monkeypatch.setattr(
        kernel, "_integrate", lambda arrays, *others: sizes.append(len(arrays["states"]))
    )
    rows = {name: np.zeros((25, 0)) for name in ("parameters", "steps", "counts", "ends", "times")}
    kernel(None, runs=25, states=np.zeros((25, 1)), samples=np.zeros((25, 2, 1)), **rows)
    assert sizes == [10, 10, 5]


@pytest.mark.parametrize(
    ("extensions", "does", "lacks"),
    [
        ("cl_khr_fp64 other", 15, ()),
        ("cl_khr_fp64", 13, ("subnormal numbers",)),
        ("cl_khr_fp16", 15, ("double precision",)),
    ],
)
def test_what_a_device_lacks(extensions: str, does: int, lacks: tuple[str, ...]) -> None:
    bits = SimpleNamespace(FMA=1, DENORM=2, INF_NAN=4, ROUND_TO_NEAREST=8)
    each = SimpleNamespace(
        extensions=extensions,
        double_fp_config=does,
        name="fast one ",
        platform=SimpleNamespace(name="maker "),
        driver_version="1.2",
        global_mem_size=8,
        max_mem_alloc_size=4,
    )
    found = devices._device(SimpleNamespace(device_fp_config=bits), 3, each)
    assert found.lacks == lacks
    assert found.described == "opencl:3 (fast one, maker 1.2)"


def test_a_device_without_enough_memory_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    cl = pytest.importorskip("pyopencl")
    kernel = devices.Kernel.__new__(devices.Kernel)
    kernel.device = devices.Device(0, "a", "b", 10**9, 10**9, (), None)

    def failing(*given: object) -> None:
        raise cl.MemoryError("clEnqueueNDRangeKernel failed: OUT_OF_RESOURCES")

    monkeypatch.setattr(kernel, "_integrate", failing)
    rows = {name: np.zeros((3, 0)) for name in ("parameters", "steps", "counts", "ends", "times")}
    assert refusal(
        EqtError, kernel, None, runs=3, states=np.zeros((3, 2)), samples=np.zeros((3, 1, 2)), **rows
    ).startswith(
        "opencl:0 (a, b) cannot integrate 3 runs of 2 states: clEnqueueNDRangeKernel failed"
    )


@from_yaml
def test_a_device_that_does_not_suit(
    monkeypatch: pytest.MonkeyPatch, text: str, message: str
) -> None:
    lacking = devices.Device(0, "slow one", "driver 1", 1, 1, ("subnormal numbers",), None)
    monkeypatch.setattr(devices, "devices", lambda: (lacking,))
    assert refusal(InputError, devices.chosen, text).startswith(message)


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyopencl", None)
    devices.devices.cache_clear()
    with pytest.raises(InputError, match=r"needs pyopencl \(extra opencl\): pip install"):
        devices.chosen("opencl")


def test_another_engine_has_no_device(invoke: Callable[..., Any]) -> None:
    called = invoke(
        "config", "check", CONFIGS / "paper.yaml", "--set", "solver.device=opencl", code=2
    )
    assert "solver.device: engine solve_ivp has none; use engine native" in called.stderr


@needs_device
def test_devices_are_listed(invoke: Callable[..., Any]) -> None:
    first = devices.devices()[0]
    assert f"opencl:0  {first.name}, {first.driver}" in invoke("list", "devices").stdout


@needs_device
@pytest.mark.ci("a driver compiles for 1 to 3 s")
def test_warnings_of_the_compiler_of_a_driver_are_not_shown(capfd: Any, tmp_path: Path) -> None:
    """PoCL's clang counts them on stderr."""
    warned = f"int *f(long x) {{ return x + {tmp_path.stat().st_ctime_ns}; }}"
    devices.Kernel(devices.chosen("opencl"), f"{warned}\n__kernel void eqt_runs(void) {{ }}\n")
    assert capfd.readouterr().err == ""
