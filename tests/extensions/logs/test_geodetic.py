"""Latitudes and longitudes in tables: against radii of curvature, and against their own slopes."""

import numpy as np
import pytest
from said import error_of

import eqt_cli
from eqt_cli.extend import group_named
from eqt_cli.extensions.logs.api import read_measured
from eqt_cli.extensions.logs.geodetic import Point, ecef, local

A, F = 6378137.0, 1 / 298.257223563
TIMES = np.arange(0.0, 12.0, 0.2)


def circle(lat, east=0.0, north=0.0, up=0.0):
    """Rows of t, lat, lon (deg), alt (m) of a circle of 30 m, by the two radii of curvature."""
    e2, s = F * (2 - F), np.sin(np.radians(lat))
    M, N = A * (1 - e2) / (1 - e2 * s * s) ** 1.5, A / np.sqrt(1 - e2 * s * s)
    x, y = 30 * np.cos(0.2 * TIMES) + east, 30 * np.sin(0.2 * TIMES) + north
    lats = lat + np.degrees(y / M)
    lons = 11.5 + np.degrees(x / (N * np.cos(np.radians(lat))))
    return np.column_stack([TIMES, lats, lons, 20 + up + 0 * TIMES])


def write(name, rows, header="t,lat,lon,alt", fmt="%.12g"):
    np.savetxt(name, rows, delimiter=",", header=header, comments="", fmt=fmt)


def rms(errors, axis="all"):
    [size] = [s for s in errors.sizes if (s.quantity, s.axis) == ("position", axis)]
    return size.rms


HEADERS = ["t,lat,lon,alt", "t,Latitude,Longitude,Altitude", "t,Lat (deg),Lng (deg),Alt (m)"]


@pytest.mark.parametrize("lat", [48.1, -34.0, 0.01, 78.0])
@pytest.mark.parametrize("header", HEADERS)
def test_errors_of_two_tracks_are_in_metres(lat, header):
    write("est.csv", circle(lat, 0.4, 0.3), header)
    write("truth.csv", circle(lat), header)
    errors = eqt_cli.log_errors("est.csv", "truth.csv")
    found = [rms(errors, axis) for axis in ("all", "x", "y")]
    assert found == pytest.approx([0.5, 0.4, 0.3], abs=2e-4)  # of a plane, over 30 m at this height


@pytest.mark.parametrize("unit", [{}, {"lat": "1e-7 deg", "lon": "degE7"}])
def test_whole_numbers_of_1e_7_deg_are_known(unit):
    """As in vehicle_gps_position of PX4, whose heights are in mm."""
    for name, rows in (("est.csv", circle(-34.0, 0.4, 0.3)), ("truth.csv", circle(-34.0))):
        whole = np.rint(rows * [1e9, 1e7, 1e7, 1e3]) / [1e9, 1, 1, 1]
        write(name, whole, fmt=["%.9f", "%d", "%d", "%d"])
    mapping = {"units": {"alt": "mm", **unit}}
    assert rms(eqt_cli.log_errors("est.csv", "truth.csv", mapping)) == pytest.approx(0.5, abs=0.02)
    checked = eqt_cli.check_log("est.csv", mapping)
    assert {c.name: c.unit for c in checked.columns if c.name != "t"}["alt"] == "mm"
    if not unit:
        assert "alt may be in mm" in error_of(eqt_cli.check_log, "est.csv").replace(
            "altitudes", "alt"
        )


def test_both_files_have_one_point_and_a_mapping_may_state_it():
    """The second file begins elsewhere; about its own first row, the error would be the way."""
    write("est.csv", circle(48.1)[10:])
    write("truth.csv", circle(48.1))
    assert rms(eqt_cli.log_errors("est.csv", "truth.csv")) < 1e-6
    about = {"geodetic": {"lat": 48.1, "lon": 11.5, "alt": 10.0}}
    point = read_measured("truth.csv", group_named("R3"), about).poses[:, :3, 3]
    expected = np.column_stack([30 * np.cos(0.2 * TIMES), 30 * np.sin(0.2 * TIMES), 10 + 0 * TIMES])
    np.testing.assert_allclose(point, expected, atol=2e-3)


def test_a_file_in_ned_becomes_north_east_and_down_first():
    write("est.csv", circle(48.1, 0.4, 0.3, up=-0.2))
    write("truth.csv", circle(48.1))
    errors = eqt_cli.log_errors("est.csv", "truth.csv", {"world": "NED to ENU"})
    assert [rms(errors, k) for k in "xyz"] == pytest.approx([0.4, 0.3, 0.2], abs=2e-4)
    said = eqt_cli.check_log("est.csv", {"world": "NED to ENU"}).notes
    assert any("x north, y east, z down" in note for note in said)


def test_without_an_altitude_positions_are_level():
    write("est.csv", circle(48.1, 0.4, 0.3)[:, :3], "t,lat,lon")
    write("truth.csv", circle(48.1)[:, :3], "t,lat,lon")
    assert any("z = 0" in note for note in eqt_cli.check_log("est.csv").notes)
    assert rms(eqt_cli.log_errors("est.csv", "truth.csv")) == pytest.approx(0.5, abs=2e-4)


@pytest.mark.parametrize(
    ("mapping", "header", "said"),
    [
        ({"columns": {"x": "lon", "y": "lat"}}, "t,lat,lon,alt", "columns.x: lon is an angle"),
        ({"columns": {"y": "gps_latitude"}}, "t,gps_latitude,b,c", "columns.y: gps_latitude is"),
        ({"units": {"lat": "m"}}, "t,lat,lon,alt", "units.lat: column lat: expected deg"),
        ({"geodetic": {"lat": 1.0}}, "t,lat,lon,alt", "geodetic: lacks lon"),
        ({}, "t,a.lat,b.lat,lon", "columns.lat: a.lat, b.lat may each be lat"),
    ],
)
def test_an_angle_is_never_a_length(mapping, header, said):
    write("est.csv", circle(48.1), header)
    assert said in error_of(eqt_cli.check_log, "est.csv", mapping)


def test_positions_that_are_there_are_taken():
    rows = np.column_stack([circle(48.1), *(np.outer(TIMES, [1.0, 2.0, 3.0]).T)])
    write("est.csv", rows, "t,lat,lon,alt,x,y,z")
    assert not any("WGS84" in note for note in eqt_cli.check_log("est.csv").notes)


def test_axes_are_those_in_which_the_ellipsoid_moves():
    """Poles and equator of WGS84; east and north are the slopes by longitude and latitude."""
    corners = np.radians([[0.0, 0.0], [0.0, 90.0], [90.0, 0.0]])
    expected = [[A, 0, 0], [0, A, 0], [0, 0, 6356752.314245179]]
    np.testing.assert_allclose(ecef(*corners.T, np.zeros(3)), expected, atol=2e-9)
    about, h = Point(-34.0, 151.0, 80.0), 1e-5
    moved = np.array([about]) + h * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1e5], [0, 0, 0]])
    enu = local(moved, about)
    np.testing.assert_allclose(
        enu / np.linalg.norm(enu, axis=1).clip(1e-9)[:, None], np.eye(4, 3), atol=1e-6
    )
