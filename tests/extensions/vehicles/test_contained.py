"""xacro and MuJoCo have bounds of time and memory, and read no files but those of the vehicle."""

import pytest

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles import contained
from eqt_cli.extensions.vehicles.vehicle_file import configuration_of

pytestmark = pytest.mark.needs("vehicles")

LINK = '<link name="b"><inertial><mass value="1"/></inertial></link>'
XACRO = f'<robot name="v" xmlns:xacro="http://www.ros.org/wiki/xacro">{LINK}…</robot>'
PROPERTY = '<xacro:property name="p" value="…"/><link name="${p}"/>'
BODY = '<body name="b"><freejoint/><geom size="0.1" mass="1"/>…</body>'
MJCF = f"<mujoco>§<worldbody>{BODY}</worldbody></mujoco>"


def refusal(path, text, **options):
    path.write_text(text)
    with pytest.raises(EqtError) as refused:
        configuration_of(path, bandwidth=5.0, **options)
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.fixture
def xacro():
    pytest.importorskip("xacro", reason="needs the extra xacro")


@pytest.fixture
def mujoco():
    pytest.importorskip("mujoco", reason="needs the extra mujoco")


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("${xacro.load_yaml('/etc/passwd')}", "/etc/passwd: expected a name relative"),
        ("${xacro.load_yaml('../../secret.yaml')}", "outside of the folder"),
        ("${xacro.load_yaml('link.yaml')}", "outside of the folder"),
        ("$(find etc)", "no folder of this package"),
    ],
)
def test_xacro_reads_no_file_elsewhere(tmp_path, xacro, without_process, formula, said):
    home = tmp_path / "src" / "urdf"
    home.mkdir(parents=True)
    (tmp_path / "secret.yaml").write_text("key: secret")
    (home / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    text = XACRO.replace("…", PROPERTY).replace("…", formula)
    message = refusal(home / "v.xacro", text)
    assert said in message
    assert "secret" not in message.replace("secret.yaml", "")


@pytest.mark.parametrize(
    ("top", "inside", "said"),
    [
        ('<include file="/etc/passwd"/>', "", "relative to the file"),
        ('<include file="../../part.xml"/>', "", "outside of the folder"),
        ("", '<site name="s" pos="nan 0 0"/>', ""),
        ('<option gravity="nan 0 0"/>', "", "gravity is nan"),
        ("", '<body name="far" pos="1e200 0 0"><geom size="1"/></body>', "at most 1e+30"),
    ],
)
def test_mujoco_reads_no_file_elsewhere_and_bounded_numbers(
    tmp_path, mujoco, without_process, top, inside, said
):
    home = tmp_path / "models" / "v"
    home.mkdir(parents=True)
    (tmp_path / "part.xml").write_text("<mujoco/>")
    motor = "</mujoco>"
    if "site" in inside:
        motor, said = '<actuator><motor site="s"/></actuator></mujoco>', "at most 1e+30"
    text = MJCF.replace("§", top).replace("…", inside).replace("</mujoco>", motor)
    assert said in refusal(home / "v.xml", text)


@pytest.mark.ci("starts processes")
def test_a_process_gets_no_environment_but_its_arguments(tmp_path, xacro, monkeypatch):
    monkeypatch.setenv("SECRET", "1")
    text = XACRO.replace("…", PROPERTY).replace("…", "$(env SECRET)")
    assert "give it with --arg SECRET=VALUE" in refusal(tmp_path / "v.xacro", text)
    told = refusal(tmp_path / "v.xacro", text, arg=["SECRET=mine"])
    assert "got mine, b" in told or "got b, mine" in told


@pytest.mark.skipif("sys.platform != 'linux'", reason="only Linux limits the address space")
@pytest.mark.ci("starts processes")
def test_what_takes_much_memory_or_crashes_is_told_so(tmp_path, xacro, mujoco):
    text = XACRO.replace("…", PROPERTY).replace("…", "${'1'.zfill(4*10**9)}")
    assert "xacro needs more than 250 MB of memory" in refusal(tmp_path / "v.xacro", text)
    text = MJCF.replace("§", '<size memory="100G"/>').replace("…", "")
    assert "MuJoCo needs more than 250 MB of memory" in refusal(tmp_path / "v.xml", text)
    text = """<mujoco><asset><model name="o" file="v.xml"/></asset><worldbody><attach model="o"
    prefix="p"/><body name="b"><freejoint/><geom type="sphere" size="0.1" mass="1"/><site name="s"
    pos="0.1 0 0"/></body></worldbody></mujoco>"""
    assert "MuJoCo crashed on it (SIG" in refusal(tmp_path / "v.xml", text)


@pytest.mark.ci("uses up two seconds of the processor")
def test_what_takes_long_is_ended(tmp_path, xacro, monkeypatch):
    monkeypatch.setattr(contained, "PATIENCE", 2 / contained.SECONDS)
    text = XACRO.replace("…", PROPERTY).replace("…", "${math.factorial(10**7) % 7}")
    assert "xacro gave no answer within 2 s" in refusal(tmp_path / "v.xacro", text)
