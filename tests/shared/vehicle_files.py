"""Small vehicles of our own, in the formats of others, and what is read of configurations."""

import numpy as np

MOTOR = """
<plugin filename="gz-sim-multicopter-motor-model-system" name="MulticopterMotorModel">
  <jointName>joint{0}</jointName><linkName>rotor{0}</linkName>
  <turningDirection>{1}</turningDirection><motorNumber>{0}</motorNumber>
  <timeConstantUp>0.01</timeConstantUp><timeConstantDown>0.02</timeConstantDown>
  <maxRotVelocity>1000</maxRotVelocity><motorConstant>1e-5</motorConstant>
  <momentConstant>0.02</momentConstant><rotorDragCoefficient>1e-4</rotorDragCoefficient>
</plugin>"""
ROTOR = """
<link name="rotor{0}"><pose>{1} {2} 0.05 0 0 0</pose>
  <inertial><mass>0.1</mass>
  <inertia><ixx>1e-5</ixx><iyy>2e-5</iyy><izz>3e-5</izz></inertia></inertial></link>
<joint name="joint{0}" type="revolute"><parent>base</parent><child>rotor{0}</child>
  <axis><xyz>0 0 1</xyz></axis></joint>"""
BASE = """
<link name="base">
  <inertial><mass>1.6</mass>
  <inertia><ixx>0.01</ixx><iyy>0.02</iyy><izz>0.025</izz></inertia></inertial></link>"""
PLACES = [(0.2, -0.3), (-0.2, 0.3), (0.2, 0.3), (-0.2, -0.3)]
TURNS = ("ccw", "ccw", "cw", "cw")

LINKS = BASE + "".join(ROTOR.format(k, *at) for k, at in enumerate(PLACES))
MOTORS = "".join(MOTOR.format(k, TURNS[k]) for k in (2, 0, 3, 1))


def sdf(inside, *, version="1.9", name="quad", attributes=""):
    """An SDF file of one model."""
    return f'<sdf version="{version}"><model name="{name}"{attributes}>{inside}</model></sdf>'


QUAD = sdf(LINKS + MOTORS)

# 1.6 kg at the base and four rotors of 0.1 kg at (±0.2, ±0.3, 0.05), by hand:
MASS = 2.0
CENTRE = [0.0, 0.0, 0.01]
MOMENTS = [
    0.01 + 1.6 * 0.01**2 + 4 * (1e-5 + 0.1 * (0.3**2 + 0.04**2)),
    0.02 + 1.6 * 0.01**2 + 4 * (2e-5 + 0.1 * (0.2**2 + 0.04**2)),
    0.025 + 4 * (3e-5 + 0.1 * (0.2**2 + 0.3**2)),
]

ROV = sdf(
    """
<link name="hull"><inertial><pose>0 0 -0.02 0 0 0</pose><mass>10</mass>
  <inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.3</izz></inertia></inertial>
  <collision name="c"><pose>0 0 0.1 0 0 0</pose>
    <geometry><box><size>0.5 0.2 0.11</size></box></geometry></collision></link>"""
    + "".join(
        f"""
<link name="t{k}"><pose>{at}</pose><inertial><mass>1e-9</mass>
  <inertia><ixx>1e-9</ixx><iyy>1e-9</iyy><izz>1e-9</izz></inertia></inertial></link>
<joint name="j{k}" type="revolute"><parent>hull</parent><child>t{k}</child>
  <axis><xyz>{along}</xyz></axis></joint>
<plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">
  <joint_name>j{k}</joint_name><max_thrust_cmd>50</max_thrust_cmd>
  <min_thrust_cmd>-40</min_thrust_cmd></plugin>"""
        for k, (at, along) in enumerate(
            [
                ("0.2 0.2 0 0 0 0", "1 -1 0"),
                ("0.2 -0.2 0 0 0 0", "1 1 0"),
                ("-0.2 0.2 0 0 0 0", "1 1 0"),
                ("-0.2 -0.2 0 0 0 0", "1 -1 0"),
                ("0.2 0.2 0 0 0 0", "0 0 1"),
                ("0.2 -0.2 0 0 0 0", "0 0 1"),
                ("-0.2 0.2 0 0 0 0", "0 0 1"),
                ("-0.2 -0.2 0 0 0 0", "0 0 1"),
            ]
        )
    )
    + """
<plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
  <link_name>hull</link_name>
  <xDotU>-5</xDotU><yDotV>-6</yDotV><zDotW>-7</zDotW>
  <kDotP>-0.1</kDotP><mDotQ>-0.2</mDotQ><nDotR>-0.3</nDotR>
  <xU>-4</xU><yV>-5</yV><zW>-6</zW><kP>-0.4</kP><mQ>-0.5</mQ><nR>-0.6</nR>
  <xUabsU>-14</xUabsU><yVabsV>-15</yVabsV><zWabsW>-16</zWabsW>
</plugin>""",
    name="rov",
)

URDF = """<robot name="cf2">
<properties kf="3e-10" km="7e-12" thrust2weight="2" drag_coeff_xy="1e-6"/>
<link name="base_link"><inertial><mass value="0.03"/>
  <inertia ixx="1e-5" ixy="2e-6" ixz="0" iyy="1e-5" iyz="0" izz="2e-5"/></inertial></link>
{}</robot>""".format(
    "".join(
        f"""<link name="prop{k}_link"><inertial><origin xyz="{x} {y} 0"/><mass value="0"/>
  <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
<joint name="p{k}" type="fixed"><parent link="base_link"/><child link="prop{k}_link"/></joint>"""
        for k, (x, y) in enumerate([(0.03, -0.03), (-0.03, -0.03), (-0.03, 0.03), (0.03, 0.03)])
    )
)


def tensor(config):
    """The tensor about the centre of mass."""
    xx, xy, xz, yy, yz, zz = config["inertia"]["urdf"]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def thrusters(config):
    """The rotors or thrusters."""
    return config["actuators"][0]
