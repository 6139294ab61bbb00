"""Where the bodies went: what is drawn is what the result holds."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml
from said import error_of, says

import eqt_cli
from eqt_cli.cli.plot import _of_one
from eqt_cli.extend import EqtError
from eqt_cli.extensions.paths.figures import PathFigure, PoseFigure, broken
from eqt_cli.figures.layout import diverging
from eqt_cli.figures.shapes import CORNERS, FACES, camera, outline, rotors

pytestmark = pytest.mark.usefixtures("unarranged")


SE3 = Path(__file__).parents[3] / "configs" / "se3.yaml"


def curve(axes, label):
    (line,) = [line for line in axes.lines if line.get_label() == label]
    return np.stack(line.get_data(), axis=-1)


@pytest.mark.parametrize(
    ("view", "shown"), [("xy", {"xy": [0, 1]}), ("planes", {"xy": [0, 1], "xz": [0, 2]})]
)
def test_positions_in_planes_are_those_of_the_result(view, shown, se3, opened, picture):
    results = opened(se3)
    drawing = picture(PathFigure(view=view), results)
    assert [axes.get_label() for axes in drawing.axes] == [f"{name} 0" for name in shown]
    for axes, places in zip(drawing.axes, shown.values(), strict=True):
        for k, label in enumerate(results.labels):
            drawn = curve(axes, f"{label} 0")
            np.testing.assert_array_equal(drawn, results["pose"][k, 0][:, places, 3])
        np.testing.assert_array_equal(
            curve(axes, "desired 0"), results["desired_pose"][:, places, 3]
        )
        assert axes.get_aspect() == 1.0


def test_colours_are_those_of_the_distance_from_the_reference(se3, opened):
    results = opened(se3)
    drawing = PathFigure(view="xy", colour="error").draw([results], "column")
    *panels, bar = drawing.axes
    assert len(panels) == len(results.labels)
    assert bar.get_ylabel().startswith("distance from the reference")
    shades = bar._colorbar.mappable
    for k, axes in enumerate(panels):
        apart = results["pose"][k, 0][:, :3, 3] - results["desired_pose"][:, :3, 3]
        error = np.sqrt((apart**2).sum(axis=-1))
        (pieces,) = [each for each in axes.collections if len(each.get_segments()) > 9]
        expected = shades.cmap(shades.norm((error[:-1] + error[1:]) / 2))
        np.testing.assert_allclose(pieces.get_colors(), expected, rtol=0, atol=1e-12)
    assert shades.norm.vmax >= error.max()


def test_scales_are_equal_in_all_panels(se3, opened):
    for width in ("column", "slide"):
        drawing = PathFigure(view="planes", runs=3).draw([opened(se3)], width)
        drawing.canvas.draw()
        assert len(drawing.axes) == 8
        for axes in drawing.axes:
            box = axes.get_window_extent()
            across, up = (np.ptp(lim) for lim in (axes.get_xlim(), axes.get_ylim()))
            assert box.width / across == pytest.approx(box.height / up, rel=1e-9)


def test_the_plane_is_that_of_the_motion(se3, altered, opened, picture):
    assert len(picture(PathFigure(), opened(se3)).axes) == 2  # in space
    pose, desired = opened(se3)["pose"].copy(), opened(se3)["desired_pose"].copy()
    pose[..., 1, 3] = desired[..., 1, 3] = 2.0
    (axes,) = PathFigure().draw([altered(se3, pose=pose, desired_pose=desired)]).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == (r"$x$ $(\mathrm{m})$", r"$z$ $(\mathrm{m})$")


def test_a_path_on_the_sphere_is_that_of_the_body_axis(so3, opened, picture):
    """R e_x seen by an eye at the tip of the third of three orthonormal rows."""
    results = opened(so3)
    drawing = picture(PathFigure(axis="x"), results)
    tips = results["pose"][2, 0][:, :, 0]  # nog
    axes = drawing.axes[2]
    near, far = (curve(axes, f"nog 0{side}") for side in ("", ", far side"))
    drawn = np.where(np.isfinite(near), near, far)
    assert np.isfinite(drawn).all()
    rows = np.linalg.lstsq(tips, drawn, rcond=None)[0].T
    np.testing.assert_allclose(tips @ rows.T, drawn, atol=1e-12)  # of 41 samples: a linear map,
    np.testing.assert_allclose(rows @ rows.T, np.eye(2), atol=1e-12)  # without a change of lengths
    towards = np.cross(*rows)
    assert (np.isfinite(near[:, 0]) >= (tips @ towards > 1e-9)).all()


def test_a_path_that_winds_often_is_an_angle_over_time_unless_the_sphere_is_asked(
    so3, altered, opened
):
    pose = opened(so3)["pose"].copy()
    angle = np.linspace(0, 5 * np.pi, pose.shape[2])  # 2.5 turns, seen from outside of the axis
    turn = np.zeros((*angle.shape, 3, 3))
    turn[:, 0, 0], turn[:, 1, 1], turn[:, 2, 2] = 1, np.cos(angle), np.cos(angle)
    turn[:, 2, 1], turn[:, 1, 2] = np.sin(angle), -np.sin(angle)
    pose[0, 0] = turn
    wound = altered(so3, pose=pose)
    [axes] = PathFigure(controllers=["eqt"], runs=1).draw([wound]).axes
    desired = wound["desired_pose"][:, :, 2]
    away = np.degrees(np.arccos(np.clip((turn[..., 2] * desired).sum(-1), -1, 1)))
    off = np.abs(np.linalg.norm(desired, axis=-1) - 1).max()  # which the two formulas see apart
    assert off < 1e-4
    np.testing.assert_allclose(axes.lines[0].get_ydata(), away, atol=np.degrees(10 * off) + 1e-5)
    [axes] = PathFigure(controllers=["eqt"], runs=1, view="sphere").draw([wound]).axes
    assert axes.get_label() == "sphere 0"


def test_an_error_on_the_sphere_is_that_of_the_axis_from_where_it_should_be(so3, opened, picture):
    """R R_dᵀ e_z, beside e_z itself."""
    results = opened(so3)
    drawing = picture(PathFigure(error=True), results)
    assert "under the error" in drawing.get_supxlabel()
    tips = (results["pose"][0, 0] @ np.swapaxes(results["desired_pose"], -1, -2))[..., 2]

    def drawn(name):
        near, far = (curve(drawing.axes[0], f"{name}{side}") for side in ("", ", far side"))
        return np.where(np.isfinite(near), near, far)

    rows = np.linalg.lstsq(tips, drawn("eqt 0"), rcond=None)[0].T
    np.testing.assert_allclose(tips @ rows.T, drawn("eqt 0"), atol=1e-12)
    still = drawn("desired 0")
    # R_d R_dᵀ is I but for the drift of this coarse solver, 3e-5.
    np.testing.assert_allclose(still, np.broadcast_to(rows[:, 2], still.shape), atol=1e-4)


def test_runs_have_panels_by_law_and_a_dark_reference(se3, opened, picture):
    drawing = picture(PathFigure(view="xz", runs=2), opened(se3))
    assert [axes.get_title() for axes in drawing.axes] == ["EqT", "GT", "nog", "asym"]
    run = opened(se3)["pose"][1, 1][:, [0, 2], 3]
    np.testing.assert_array_equal(curve(drawing.axes[1], "gt 1"), run)
    assert drawing.get_supxlabel() == "First 2 runs."


def test_a_reference_that_rests_is_a_cross(se3, altered, opened):
    desired = np.broadcast_to(np.eye(4), opened(se3)["desired_pose"].shape)
    drawing = PathFigure(view="xy").draw([altered(se3, desired_pose=desired)])
    (cross,) = (line for line in drawing.axes[0].lines if line.get_label() == "desired 0")
    assert (cross.get_marker(), cross.get_markevery()) == ("+", [-1])
    assert "+" in {str(handle.get_marker()) for handle in drawing.legends[0].legend_handles}


@pytest.mark.parametrize("width", ["column", "page", "slide"])
def test_a_flat_path_keeps_clear_of_its_legend_and_remarks(width, se3, altered, opened):
    pose = opened(se3)["pose"].copy()
    pose[..., 0, 3] *= 4.0
    (axes, *_), drawing = flat(altered(se3, pose=pose), width)
    panel, legend = axes.get_tightbbox(), drawing.legends[0].get_window_extent()
    remarks = drawing.findobj(lambda each: each is drawing._supxlabel)[0].get_window_extent()
    assert remarks.y1 <= panel.y0 + 2 and panel.y1 <= legend.y0 + 2


def flat(result, width):
    drawing = PathFigure(view="planes", controllers=["eqt", "gt"]).draw([result], width)
    drawing.canvas.draw()
    return drawing.axes, drawing


def test_a_law_that_leaves_is_cut_off_and_named(se3, altered, opened):
    pose = opened(se3)["pose"].copy()
    pose[1, 0, :, 0, 3] += 10.0 ** np.linspace(-3, 6, 41)
    drawing = PathFigure(view="xz").draw([altered(se3, pose=pose)])
    assert np.ptp(drawing.axes[0].get_xlim()) < 50
    assert "Cut off where it leaves the reference: “GT”." in drawing.get_supxlabel()


def test_a_path_ends_where_it_leaves_and_does_not_come_back(se3, altered, opened):
    pose = opened(se3)["pose"].copy()
    pose[1, 0, 20:, 0, 3] = 1e6
    pose[1, 0, 30:35, :3, 3] = pose[0, 0, 30:35, :3, 3]
    axes = PathFigure(view="xz").draw([altered(se3, pose=pose)]).axes[0]
    assert np.flatnonzero(np.isfinite(curve(axes, "gt 0")).all(axis=-1)).tolist() == [*range(20)]


@pytest.mark.parametrize(("up", "down"), [(1, False), (-1, True)])
def test_a_last_axis_that_points_down_is_drawn_so(up, down, simulate, opened):
    """In the plane and in space; the file says which way is up."""
    forces = [{"kind": "restoring", "weight": 1.0, "up": [0, 0, up]}]
    brief = {"time": {"duration": 0.5, "samples": 3}, "controllers": ["eqt"], "inertia": 1.0}
    brief["reference"] = {"torque": ["0.1", "0", "0", "0", "0.2", "0"]}
    result = opened(simulate(group="SE3", plant={"forces": forces}, **brief))
    (axes,) = PathFigure(view="xz").draw([result]).axes
    assert axes.yaxis_inverted() == down
    assert axes.get_ylabel() == r"$z$ $(\mathrm{m})$" + ", down" * down
    (room,) = PathFigure(view="space").draw([result]).axes
    drawn = curve(room, "eqt 0")
    height = result["pose"][0, 0, :, 2, 3] * up
    sideways = result["pose"][0, 0, :, :2, 3] * [1, up]
    seen = np.column_stack([sideways, height]) @ camera()[:2].T
    np.testing.assert_allclose(drawn, seen, atol=1e-12)


def test_results_of_which_one_points_down_are_not_drawn_together(simulate, opened):
    brief = {"time": {"duration": 0.5, "samples": 3}, "controllers": ["eqt"], "inertia": 1.0}
    brief |= {"group": "SE3", "reference": {"torque": ["0.1", "0", "0", "0", "0.2", "0"]}}
    both = [
        opened(simulate(plant={"forces": [{"kind": "restoring", "weight": 1, "up": up}]}, **brief))
        for up in ([0, 0, 1], [0, 0, -1])
    ]
    with pytest.raises(EqtError, match="draws a last axis up or down; show these results by"):
        PathFigure().draw(both)


def test_diverging_is_what_ends_ten_times_above_all_others():
    falls, grows = np.linspace(1, 0, 5), np.linspace(1, 9.9, 5)
    assert diverging({"a": falls, "b": grows}) == []
    assert diverging({"a": falls, "b": 2 * grows, "c": 3 * grows}) == ["b", "c"]
    assert diverging({"a": 100 * falls, "b": falls}) == []  # it comes from far away
    assert diverging({"a": grows}) == []


def test_bodies_stand_on_the_path(se3, opened, picture):
    results = opened(se3)
    drawing = picture(PathFigure(view="xy", bodies=3, controllers=["eqt"], runs=1), results)
    bodies = drawing.axes[0].collections
    middles = [
        np.mean([path.vertices[:4].mean(axis=0) for path in b.get_paths()], 0) for b in bodies
    ]
    expected = results["pose"][0, 0][[0, 20, 40], :2, 3]
    np.testing.assert_allclose(middles, expected, atol=1e-12)  # a box is symmetric


def test_outlines_are_a_box_or_rotors(se3, opened):
    results = opened(se3)
    assert not len(rotors(results))
    boxes = outline(results)
    assert np.array_equal(boxes, [CORNERS[list(face)] for face in FACES])


@from_yaml
def test_what_it_refuses(options, result, message, opened, request):
    path = request.getfixturevalue(result)
    said = error_of(PathFigure(**options).draw, [opened(path)])
    assert says(said, message.format(path=path))


def test_pose_shows_components_reference_and_errors(se3, opened, picture):
    from scipy.spatial.transform import Rotation

    results = opened(se3)
    drawing = picture(PoseFigure(run=2), results)
    panels = {axes.get_ylabel(): axes for axes in drawing.axes}
    assert list(panels) == [
        r"$x$ $(\mathrm{m})$", r"roll $(\mathrm{deg})$",
        r"$y$ $(\mathrm{m})$", r"pitch $(\mathrm{deg})$",
        r"$z$ $(\mathrm{m})$", r"yaw $(\mathrm{deg})$",
        r"$\|p - p_{\mathrm{d}}\|$ $(\mathrm{m})$", r"attitude error $(\mathrm{deg})$",
    ]  # fmt: skip
    pose = results["pose"][0, 2]
    y = curve(panels[r"$y$ $(\mathrm{m})$"], "eqt")[:, 1]
    np.testing.assert_array_equal(y, pose[:, 1, 3])
    yaws = Rotation.from_matrix(pose[:, :3, :3]).as_euler("ZYX", degrees=True)
    for name, expected in zip(("yaw", "pitch", "roll"), yaws.T, strict=True):
        drawn = curve(panels[rf"{name} $(\mathrm{{deg}})$"], "eqt")[:, 1]
        there = np.isfinite(drawn)
        turns = (drawn - expected)[there] / 360
        # SciPy makes the matrix orthonormal first; at rtol 1e-3 it is so to 1e-6, and a steep pitch
        # enlarges that.
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-5)
        assert there.sum() > 35
    errors = curve(panels[r"attitude error $(\mathrm{deg})$"], "gt")[:, 1]
    np.testing.assert_array_equal(errors, results["attitude_angle"][1, 2])


def test_near_a_steep_pitch_the_rotation_vector_of_the_error_is_drawn(se3, altered, opened):
    from scipy.spatial.transform import Rotation

    result = opened(se3)
    up = Rotation.from_euler("ZYX", [0.4, np.radians(85), 0.2]).as_matrix()
    pose, desired = result["pose"].copy(), result["desired_pose"].copy()
    pose[..., :3, :3] = pose[..., :3, :3] @ up
    desired[:, :3, :3] = desired[:, :3, :3] @ up
    drawing = PoseFigure(run=2).draw([altered(se3, pose=pose, desired_pose=desired)])
    R, Rd = (of[..., :3, :3] for of in (pose[1, 2], desired))
    vectors = Rotation.from_matrix(R @ Rd.swapaxes(-1, -2)).as_rotvec(degrees=True)
    for k, axis in enumerate("xyz"):
        (panel,) = (x for x in drawing.axes if x.get_ylabel().startswith(f"error ${axis}$"))
        drawn = curve(panel, "gt")[:, 1]
        there = np.isfinite(drawn)
        # The solver keeps R orthonormal to its tolerance, 1e-3, which SciPy mends first.
        np.testing.assert_allclose(drawn[there], vectors[there, k], atol=np.degrees(1e-3))
        assert there.sum() > 35
        np.testing.assert_allclose(curve(panel, "desired")[:, 1], 0, atol=1e-4)


def test_the_transient_alone_is_drawn_of_a_long_time_that_nobody_chose(se3, altered, opened):
    """Errors of exp(−10 t/T) are below 10 % from 0.23 T on, and 1.2 times this is within 0.3 T."""
    result = opened(se3)
    last = float(result.times[-1])
    decay = np.broadcast_to(np.exp(-10 * result.times / last), result["attitude_angle"].shape)
    settled = altered(se3, attitude_angle=decay, position_error=decay)
    ends = [PoseFigure(end=end).draw([settled]).axes[0].get_xlim()[1] for end in (None, last)]
    np.testing.assert_allclose(ends, [0.3 * last, last])


def test_all_laws_start_where_they_start(se3, altered, opened):
    """GT turns by whole turns afterwards, which moves none of its angles."""
    from scipy.spatial.transform import Rotation

    pose = np.broadcast_to(np.eye(4), opened(se3)["pose"].shape).copy()
    yaw = Rotation.from_euler("z", (np.linspace(0, 9 * np.pi, 41) + 3)[:, None]).as_matrix()
    pose[0, ..., :3, :3], pose[1, ..., :3, :3] = yaw[0], yaw
    changed = altered(se3, pose=pose, desired_pose=pose[2, 0])
    drawing = PoseFigure(controllers=["eqt", "gt"]).draw([changed])
    (panel,) = (axes for axes in drawing.axes if axes.get_ylabel().startswith("yaw"))
    for law in ("eqt", "gt"):
        drawn = curve(panel, law)[:, 1]
        assert drawn[0] == pytest.approx(np.degrees(3))
        assert np.nanmax(abs(drawn)) <= 180


def test_lines_of_angles_break_at_turns():
    grows = np.linspace(0, 20, 201)
    wrapped = np.arctan2(np.sin(grows), np.cos(grows))[:, None]
    turns = np.searchsorted(grows, np.pi * np.array([1, 3, 5])).tolist()
    drawn = broken(wrapped)
    assert np.flatnonzero(np.isnan(drawn[:, 0])).tolist() == turns
    there = np.isfinite(drawn)
    np.testing.assert_array_equal(drawn[there], wrapped[there])


def test_by_default_it_is_drawn_where_there_are_positions(se3, so3, opened):
    assert _of_one(opened(se3)) == ["path", "summary", "pose"]
    assert _of_one(opened(so3)) == ["summary"]


def test_a_pose_of_two_results_with_other_samples(made_once):
    settings = {"ensemble.runs": 1, "time.duration": 1.0, "solver.cross_check": 0}

    def make(folder):
        for samples in (21, 31):
            loaded = eqt_cli.load_experiment(SE3, settings | {"time.samples": samples})
            eqt_cli.run(loaded, folder / str(samples))

    folder = made_once("poses of other samples", make)
    drawing = eqt_cli.figure([folder / "21", folder / "31"], "pose")
    assert {len(line.get_xdata()) for line in drawing.axes[0].lines} == {21, 31}


@pytest.mark.parametrize("figure", [PathFigure, PoseFigure])
def test_of_many_laws_the_first_and_those_that_end_nearest_are_drawn(
    figure, se3, altered, opened, monkeypatch
):
    errors = opened(se3)["attitude_angle"].copy()
    labels = opened(se3).labels
    errors[...] = np.array([4.0, 2.0, 3.0, 1.0])[:, None, None]
    monkeypatch.setattr("eqt_cli.extensions.paths.figures._most_together", lambda _: 2)
    drawing = figure().draw([altered(se3, attitude_angle=errors)], "column")
    drawn = {line.get_label().split()[0] for axes in drawing.axes for line in axes.lines}
    assert drawn & set(labels) == {labels[0], labels[3]}
    title = opened(se3).titles[0]
    assert f"{title} and the 1 of 4 laws with the least closing error" in drawing.get_supxlabel()
    errors[0] = 0.5
    captions = []
    figure().draw([altered(se3, attitude_angle=errors)], "column", captions=captions)
    assert any(said.startswith("2 of 4 laws with the least closing error; no") for said in captions)
