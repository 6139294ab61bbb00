"""What a run writes: every variable with its dimensions and units, whatever is kept of it."""

from contextlib import ExitStack

import numpy as np
import pytest
from plugin_sources import ESCAPE, component
from stored import of_variable_length

from eqt_cli.base.store_reader import open_results

RUN, TIME = ("controller", "run"), ("controller", "run", "time")

VARIABLES = {
    "pose": ((*TIME, "row", "col"), "1"),
    "velocity": ((*TIME, "axis"), "rad/s"),
    "torque": ((*TIME, "axis"), "N m"),
    "pose_error": (TIME, "1"),
    "velocity_error": (TIME, "rad/s"),
    "torque_norm": (TIME, "N m"),
    "lyapunov": (TIME, "J"),
    "attitude_angle": (TIME, "deg"),
    "desired_pose": (("time", "row", "col"), "1"),
    "desired_velocity": (("time", "axis"), "rad/s"),
    "desired_torque": (("time", "axis"), "N m"),
    "initial_pose": (("run", "row", "col"), "1"),
    "initial_velocity": (("run", "axis"), "rad/s"),
    "mean_torque": (RUN, "N m"),
    "effort": (RUN, "(N m)^2 s"),
    "peak_torque": (RUN, "N m"),
    "early_torque": (RUN, "N m"),
    "mean_pose_error": (RUN, "1"),
    "final_pose_error": (RUN, "1"),
    "mean_attitude_error": (RUN, "deg"),
    "peak_attitude_error": (RUN, "deg"),
    "final_attitude_error": (RUN, "deg"),
    "final_velocity_error": (RUN, "rad/s"),
    "settling_time": (RUN, "s"),
    "steps": (RUN, "1"),
    "group_drift": (RUN, "1"),
    "energy_residual": (RUN, "1"),
    "unstable_distance": (RUN, "1"),
    "error_estimate": (RUN, "mixed"),
    "reference_residual": (RUN, "mixed"),
    "status": (RUN, "1"),
    "message": (RUN, ""),
}
TRAJECTORIES = [name for name, (dims, _) in VARIABLES.items() if dims[:3] == TIME]
METRICS = [name for name, (dims, _) in VARIABLES.items() if dims == RUN]

RIGID = {
    "group": "SE3",
    "inertia": "[2, 1, 3, 4, 4, 4]",
    "reference": "{kind: constant, velocity: [0, 0, 1, 1, 0, 0]}",
    "initial": "{pose: {kind: haar, position: {std: 1.0}}, velocity: {kind: normal, std: 0.5}}",
}


@pytest.fixture
def results(run):
    """The open result of a run."""
    with ExitStack() as stack:

        def read(*overrides, **options):
            found = open_results(run(*overrides, **options).folder.results)
            return stack.enter_context(found)

        yield read


@pytest.fixture
def whole(default_result):
    """All that a run without any change writes."""
    with open_results(default_result) as found:
        yield found


def described(results):
    return {name: (results.dims(name), results.units(name)) for name in results.names}


# The layout -------------------------------------------------------------------------------------


def test_every_variable_with_its_dimensions_and_units(whole):
    found = whole
    assert described(found) == VARIABLES
    assert dict(found.dimensions) == {
        "controller": 2,
        "run": 3,
        "time": 11,
        "row": 3,
        "col": 3,
        "axis": 3,
    }
    assert all(found.long_name(name) != name for name in found.names)


def test_coordinates(whole):
    found = whole
    assert list(found.coordinate("controller")) == ["eqt", "gt"]
    assert list(found.coordinate("axis")) == ["ωx", "ωy", "ωz"]
    np.testing.assert_array_equal(found.coordinate("time"), np.linspace(0.0, 1.0, 11))
    assert found.units("time") == "s"


def test_rotation_and_translation_have_norms_of_their_own(run):
    run(**RIGID)
    with open_results("out") as found:
        mixed = described(found)
        units = {"pose_error": ("1", "m"), "velocity_error": ("rad/s", "m/s")}
        for norm, (rotation, translation) in (units | {"torque_norm": ("N m", "N")}).items():
            assert {name: mixed[name][1] for name in mixed if name.startswith(norm)} == {
                norm: "mixed",
                f"{norm}_rotation": rotation,
                f"{norm}_translation": translation,
            }
            parts = np.hypot(found[f"{norm}_rotation"], found[f"{norm}_translation"])
            # Two orders of summation: a few units in the last place.
            np.testing.assert_allclose(found[norm], parts, rtol=1e-14)
        assert mixed["effort"] == (RUN, "mixed")
        assert mixed["settling_time"] == (RUN, "s")
        sizes = {"controller": 2, "run": 3, "time": 11, "row": 4, "col": 4, "axis": 6}
        assert dict(found.dimensions) == sizes


def test_no_string_has_a_variable_length(paper_result, swept_result):
    """At one, Octave's `load` stops."""
    for result in (paper_result, swept_result):
        assert of_variable_length(result / "results.h5") == []


def test_xarray_opens_it_with_labels_units_and_long_names(default_result):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    with xarray.open_dataset(default_result / "results.h5", engine="h5netcdf") as ds:
        assert set(ds.data_vars) == set(VARIABLES)
        assert {name: ds[name].dims for name in VARIABLES} == {
            name: dims for name, (dims, _) in VARIABLES.items()
        }
        assert ds["torque"].attrs == {"units": "N m", "long_name": "control torque tau, body frame"}
        one = ds.sel(controller="eqt", run=2, axis="ωz").sel(time=0.49, method="nearest")
        assert float(one["time"]) == pytest.approx(0.5, abs=1e-12)
        assert float(one["torque"]) == ds["torque"].values[0, 2, 5, 2]
        messages = ds["message_text"].values[ds.sel(controller="gt")["message"]]
        assert messages.tolist() == ["", "", ""]


# What the numbers are ---------------------------------------------------------------------------


def test_the_signals_are_those_of_the_states(whole):
    found = whole
    Q, Qd, V = found["pose"], found["desired_pose"], found["velocity"]
    error = np.linalg.norm(np.eye(3) - Q @ Qd.swapaxes(-1, -2), axis=(-2, -1))
    # Each run carries a reference of its own, which is the desired one within the tolerance of
    # 1e-6, amplified a little.
    np.testing.assert_allclose(found["pose_error"], error, atol=1e-5)
    deviation = np.linalg.norm(V - found["desired_velocity"], axis=-1)
    np.testing.assert_allclose(found["velocity_error"], deviation, atol=1e-5)
    assert np.abs(found["reference_residual"]).max() < 1e-5
    norm = np.linalg.norm(found["torque"], axis=-1)
    np.testing.assert_allclose(found["torque_norm"], norm, rtol=1e-14)


def test_runs_start_where_they_were_drawn(whole):
    found = whole
    for controller in range(2):
        np.testing.assert_array_equal(
            found["pose"][controller, :, 0], found["initial_pose"], err_msg=str(controller)
        )
        # V = 𝕀⁻¹(𝕀 V): one rounding each way.
        np.testing.assert_allclose(
            found["velocity"][controller, :, 0], found["initial_velocity"], rtol=1e-14
        )


def test_the_energy_balance_holds(whole):
    # W is integrated at rtol 1e-6 along with a state that varies by a few units.
    assert whole["energy_residual"].max() < 1e-5


# What is kept -----------------------------------------------------------------------------------


def test_some_samples_of_some_runs_are_kept_and_compressed(results, whole):
    some = ("store.trajectories=2", "store.decimate=3", "store.compression=gzip")
    part = results(*some, out="part")
    assert (part.dimensions["stored_run"], part.dimensions["run"]) == (2, 3)
    assert part.dims("torque")[:3] == ("controller", "stored_run", "time")
    np.testing.assert_array_equal(part.coordinate("time"), whole.coordinate("time")[::3])
    for name in TRAJECTORIES:
        np.testing.assert_array_equal(part[name], whole[name][:, :2, ::3], err_msg=name)
    np.testing.assert_array_equal(part["desired_pose"], whole["desired_pose"][::3])
    for name in METRICS:
        np.testing.assert_array_equal(part[name], whole[name], err_msg=name)


# Runs that fail ---------------------------------------------------------------------------------

UNDEFINED = component("""
undefined(eqt_cli.components.laws.Controller):
    title: ClassVar[str] = "Undefined"

    def torque(self, s):
        return s.V_tilde * float("nan")  # nowhere a value, not even on the reference
""")


@pytest.mark.parametrize(
    "engine", ["solve_ivp", pytest.param("native", marks=pytest.mark.ci("compiles two laws"))]
)
def test_a_failed_run_is_a_row_and_harms_no_other(results, folder, engine):
    (folder / "law.py").write_text(ESCAPE + UNDEFINED, encoding="utf-8")
    both = {
        "solver": f"{{engine: {engine}, rtol: 1.0e-3, cross_check: 0}}",
        "ensemble": "{runs: 2, seed: 1}",
    }
    alone = results(out="alone", controllers="[eqt]", **both)
    found = results(plugins="[law.py]", controllers="[escape, eqt]", **both)
    assert (found["status"][0] != 0).all()
    assert all(message.startswith("t = ") for message in found["message"][0])
    assert np.isnan(found["pose"][0, :, -1]).all()
    assert np.isfinite(found["pose"][0, :, 0]).all()
    assert np.isnan(found["effort"][0]).all()
    assert not found["status"][1].any()
    for name in alone.names:
        if name.startswith(("desired", "initial")):
            np.testing.assert_array_equal(found[name], alone[name], err_msg=name)
        else:
            np.testing.assert_array_equal(found[name][1], alone[name][0], err_msg=name)


def test_a_law_that_fails_on_the_reference_leaves_it_to_the_others(results, folder):
    (folder / "law.py").write_text(ESCAPE + UNDEFINED, encoding="utf-8")
    alone = results(out="alone", controllers="[eqt]")
    found = results(plugins="[law.py]", controllers="[undefined, eqt]")
    assert (found["status"] != 0).tolist() == [[True] * 3, [False] * 3]
    for name in ("desired_pose", "desired_velocity", "desired_torque"):
        np.testing.assert_array_equal(found[name], alone[name], err_msg=name)
    np.testing.assert_array_equal(found["reference_residual"][1], alone["reference_residual"][0])


def test_the_largest_error_allowed(results):
    found = results("solver.error_estimate=true", "solver.max_error=1e-15")
    estimate = found["error_estimate"]
    assert (found["status"] == 4).all()
    assert found["message"][0, 0] == (
        f"error estimate {estimate[0, 0]:.2g} exceeds solver.max_error = 1e-15"
    )
    # The estimate belongs to a tolerance of 1e-6, whose errors grow a little along the run.
    assert 1e-12 < estimate.max() < 1e-4


# The cross-check --------------------------------------------------------------------------------


def checked(results):
    return {
        key.removeprefix("cross_check_"): value
        for key, value in results.attributes.items()
        if key.startswith("cross_check_")
    }


def test_an_engine_is_checked_by_another_method_and_results_do_not_depend_on_it(results, whole):
    none, some = whole, results("solver.cross_check=2", out="checked")
    found = checked(some)
    assert (found["method"], found["runs"], found["bound"]) == ("LSODA", 2, 1e-3)
    assert 0 < float(str(found["difference"])) < 1e-4
    assert checked(none) == {}
    for name in none.names:
        np.testing.assert_array_equal(none[name], some[name], err_msg=name)


def test_a_law_built_on_another_is_checked_by_its_own_torque(results, folder):
    (folder / "law.py").write_text(
        "from eqt_cli.components.laws import EqT\n\n\n"
        "class Weak(EqT):\n"
        '    name = "weak"\n\n'
        "    def torque(self, s):\n"
        "        return super().torque(s) / 2\n",
        encoding="utf-8",
    )
    found = checked(results("solver.cross_check=2", plugins="[law.py]", controllers="[eqt, weak]"))
    assert float(str(found["difference"])) < float(str(found["bound"]))


def test_distance_to_the_unstable_equilibria_is_the_least_along_the_run(results):
    """With K = diag(1, 2, 3): the half-turns about the axes."""
    file = results("gains.kp=[1, 2, 3]")
    Q_E = file["pose"] @ np.swapaxes(file["desired_pose"], -1, -2)
    half_turns = [np.diag(np.where(np.arange(3) == k, 1.0, -1.0)) for k in range(3)]
    every = [np.sqrt(((Q_E - turn) ** 2).sum(axis=(-2, -1))) for turn in half_turns]
    expected = np.min(every, axis=0).min(axis=-1)
    # `desired_pose` is from a solve of its own, at rtol 1e-6.
    np.testing.assert_allclose(file["unstable_distance"], expected, rtol=0, atol=1e-4)
