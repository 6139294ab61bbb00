"""What is said of parts of a vehicle that will not do: each mistake with its place."""

import pytest
from case_tables import cases

from eqt_cli.base.errors import ConfigError

OTHERS = {
    "SO3": {},
    "SE2": {"inertia": "[1, 2, 2]", "reference": "{torque: [0, 0, 0]}"},
    "SE3": {"inertia": "[1.0, 2.0, 2.5, 3.0, 4.0, 5.0]", "reference": "{kind: constant}"},
    "R1": {"inertia": "2.0", "reference": "{kind: constant}", "initial": "{velocity: normal}"},
}
"""What a group takes beside the mistake."""

WRONG = {
    "SO3": """
# Numbers of parts, and what they fit.
actuators: [{kind: limit, limit: -1}]
    actuators[0].limit: expected a number greater than 0, got -1
actuators: [{kind: limit, limit: true}]
    actuators[0].limit: expected a number, {uniform: [least, greatest]} or {normal: [mean, std]},
    got true
controllers: [{kind: goodarzi2013, anti_windup: clamp}]
    controllers[0].anti_windup: needs limits that follow from the command alone: of limit, of the
    torque of wheels, or of thrusters without allocation: bounded; give some, or remove this key
controllers: [{kind: goodarzi2013, anti_windup: clamps}]
    controllers[0].anti_windup: expected 'none', 'clamp' or a mapping, got 'clamps'
controllers: [{kind: goodarzi2013, anti_windup: {back_calculation: 0}}]
    controllers[0].anti_windup.back_calculation: expected a number greater than 0, got 0
actuators: [{kind: lag, time_constant: [1, 2]}]
    actuators[0].time_constant: expected 3 entries for SO3, got 2
actuators: [{kind: limiter}]
    actuators[0].kind: unknown actuator 'limiter'; did you mean 'limit'?
actuators: [{kind: limit, limit: {uniform: [2, 1]}}]
    actuators[0].limit.uniform: expected the smaller number first, got [2, 1]
actuators: [{kind: limit, limit: {normal: [1, -0.1]}}]
    actuators[0].limit.normal: expected a standard deviation of at least 0, got -0.1
plant: {inertia: {relative: -1.5}}
    plant.inertia.relative: expected a number greater than -1, got -1.5
plant: {inertia: [1, 2]}
    plant.inertia: expected 3 diagonal entries for SO3, got 2
plant: {forces: [{kind: restoring, weight: 1}]}
    plant.forces[0]: restoring needs group SE2 or SE3, got SO3
plant: {forces: [{kind: gust, std: -0.1, time_constant: 1}]}
    plant.forces[0].std: expected a standard deviation of at least 0, got -0.1
plant: {forces: [{kind: gust, std: 0.1, time_constant: 0}]}
    plant.forces[0].time_constant: expected a number greater than 0, got 0
# What acts at control instants.
control: {delay: 1}
    control.period: missing; this key is required: The laws are evaluated at t = offset + k·period,
    s, and their commands held in between
control: {period: 0}
    control.period: expected a number greater than 0, got 0
sensors: {pose: [{kind: noise, std: 0.1}]}
    sensors: act at control instants; set control.period
actuators: [{kind: rate_limit, rate: 1}]
    actuators[0]: rate_limit acts at control instants; set control.period
actuators: [{kind: quantisation, resolution: 1}]
    actuators[0]: quantisation acts at control instants; set control.period
actuators: [{kind: deadband, width: 1}]
    actuators[0]: deadband acts at control instants; set control.period
actuators: [{kind: momentum_limit, momentum: 1}]
    actuators[0]: momentum_limit acts at control instants; set control.period
control: {period: 0.1}
actuators: [{kind: lag, time_constant: 1}, {kind: rate_limit, rate: 1}]
    actuators[1]: rate_limit acts on a held command; put it before lag
control: {period: 0.1}
sensors: {velocity: [{kind: noise, std: -0.1}]}
    sensors.velocity[0].std: expected a standard deviation of at least 0, got -0.1
control: {period: 0.1}
sensors: {pose: [{kind: noise, std: {normal: [-0.1, 0.01]}}]}
    sensors.pose[0].std: expected a standard deviation of at least 0, got -0.1
control: {period: 0.1}
sensors: {pose: [{kind: bias, walk: [0, 0, {uniform: [-1, 1]}]}]}
    sensors.pose[0].walk: expected a standard deviation of at least 0, got -1
# Numbers that no motion has.
control: {period: 0.1}
sensors: {velocity: [{kind: noise, std: 1.0e+300}]}
    sensors.velocity[0].std: expected numbers of at most 1e+15, got 1e+300
control: {period: 0.1}
sensors: {pose: [{kind: bias, value: {normal: [0, 1.0e+300]}}]}
    sensors.pose[0].value.normal: expected numbers of at most 1e+15, got 1e+300
initial: {pose: {kind: exp_normal, std: [1, 1.0e+300, 1]}}
    initial.pose.std: expected numbers of at most 1e+15, got 1e+300
initial: {velocity: {kind: speed, speed: 1.0e+300}}
    initial.velocity.speed: expected numbers of at most 1e+15, got 1e+300
initial: {velocity: {kind: fixed, coordinates: [0, 0, 1.0e+300]}}
    initial.velocity.coordinates: expected numbers of at most 1e+15, got 1e+300
plant: {forces: [{kind: drag, linear: 1.0e+300}]}
    plant.forces[0].linear: expected numbers of at most 1e+15, got 1e+300
control: {period: 1.0e-7}
    control.period: expected at least 1e-06 s, which makes 1,000,000 control instants in 1 s, got
    1e-07
closing_window: 2
    closing_window: expected a number of at most 1, got 2
control: {period: 0.1}
sensors: {velocity: [noise]}
    sensors.velocity[0]: expected std or density, got neither
control: {period: 0.1}
sensors: {velocity: [{kind: nois, std: 1}]}
    sensors.velocity[0].kind: unknown sensor 'nois'; did you mean 'noise'?
plant: {forces: [{kind: drag, linear: 1, current: [0.3, 0, 0]}]}
    plant.forces[0].current: needs a group with one translation in m/s, as SE2 and SE3, got SO3;
    remove this key
actuators: [{kind: thrusters, thrusters: [{at: [0, 0, 0], along: [1, 0, 0]}]}]
    actuators[0].thrusters: places of thrusters need group SE2 or SE3, got SO3; give matrix
""",
    "SE2": """
# Limits, thrusters and rotors.
actuators: [{kind: limit, limit: 1, low: -1}]
    actuators[0]: expected limit, or low and high, got limit and low
actuators: [limit]
    actuators[0]: expected limit, or low and high, got neither; add limit: 1.0
actuators: [{kind: limit, low: -1}]
    actuators[0].high: missing; give both limits, low and high
actuators: [{kind: limit, low: [-1, 2, -1], high: 1}]
    actuators[0].low[1]: expected a number less than high, 1, got 2
actuators: [{kind: limit, low: 1, high: 1}]
    actuators[0].low: expected a number less than high, 1, got 1
actuators: [{kind: limit, low: -1, high: 1, norm: true}]
    actuators[0].norm: needs limit, got low and high; use limit, or remove this key
actuators: [{kind: limit, low: [-1, -2], high: 1}]
    actuators[0].low: expected 3 entries for SE2, got 2
actuators: [thrusters]
    actuators[0]: expected either matrix or thrusters, got neither
actuators: [{kind: thrusters, matrix: [[1]], thrusters: []}]
    actuators[0]: expected either matrix or thrusters, got both
actuators: [{kind: thrusters, matrix: [[1, 0], [0, 1]]}]
    actuators[0].matrix: expected 3 rows for SE2, in the order ω, vx, vy, got 2
actuators: [{kind: thrusters, matrix: [[1, 0], [0], [1, 1]]}]
    actuators[0].matrix[1]: expected 2 numbers, as in row 1, got 1
actuators: [{kind: thrusters, matrix: [[], [1], [1]]}]
    actuators[0].matrix[0]: expected a number or more, got none
actuators: [{kind: thrusters, matrix: [[1], [], [1]]}]
    actuators[0].matrix[1]: expected a number or more, got none
actuators: [{kind: thrusters, matrix: [[1], [0], [1]], low: [-1, -1], high: 1}]
    actuators[0].low: expected 1 entries, one for each thruster, got 2
actuators: [{kind: thrusters, matrix: [[1], [0], [1]], low: 1, high: 1}]
    actuators[0].low: expected a number less than high, 1, got 1
actuators: [{kind: thrusters, matrix: [[1], [0], [1]], time_constant: 0}]
    actuators[0].time_constant: expected a number greater than 0, got 0
control: {period: 0.1}
actuators: [{kind: thrusters, matrix: [[1], [0], [1]], allocation: bounded}]
    actuators[0]: allocation: bounded needs limits; give low and high
actuators: [{kind: thrusters, matrix: [[1], [0], [1]], low: -1, high: 1, allocation: bounded}]
    actuators[0]: allocation: bounded acts at control instants; set control.period
actuators: [{kind: thrusters, matrix: [[1, -1], [2, 2], [0, 0]], low: -1, high: 1,
  allocation: {kind: priority, order: [force, torque]}}]
    actuators[0]: allocation: priority acts at control instants; set control.period
actuators: [{kind: thrusters, matrix: [[1, -1], [2, 2], [0, 0]], low: -1, high: 1,
  allocation: priority}]
    actuators[0].allocation: expected 'pseudo_inverse', 'bounded' or a mapping, got 'priority'
actuators: [{kind: thrusters, matrix: [[1, -1], [2, 2], [0, 0]], low: -1, high: 1,
  allocation: {kind: priority}}]
    actuators[0].allocation.order: missing; this key is required: Groups of directions, the most
    important first: a name such as torque z, or a list. The word force is all forces along which
    the thrusters push, torque all torques
actuators: [{kind: thrusters, matrix: [[1, -1], [2, 2], [0, 0]], low: -1, high: 1,
  allocation: {kind: priority, order: [force, [torque, force x]]}}]
    actuators[0].allocation.order[1]: force x is named twice; name each direction once
actuators: [{kind: thrusters, matrix: [[1, -1], [2, 2], [0, 0]], low: -1, high: 1,
  allocation: {kind: priority, order: [force z, torque]}}]
    actuators[0].allocation.order[0]: expected a direction, torque, force x, force y, got 'force z'
actuators: [{kind: thrusters, matrix: [[1, -1], [2, 2], [0, 0]], low: -1, high: 1,
  allocation: {kind: priority, order: [force, torque, force y]}}]
    actuators[0].allocation.order[2]: nothing pushes along force y alone; remove it
actuators: [{kind: thrusters, matrix: [[1, -1], [2, 2], [0, 0]], low: -1, high: 1,
  allocation: {kind: priority, order: [force]}}]
    actuators[0].allocation.order: lacks torque; name each direction in which thrusters push
actuators: [{kind: thrusters, matrix: [[1, -1], [2, 2], [0, 0]], low: -1, high: 1,
  allocation: {kind: priority, order: [[], force, torque]}}]
    actuators[0].allocation.order[0]: expected text or at least 1 entry, got []
actuators: [{kind: thrusters, matrix: [[1], [0], [1]]}, {kind: thrusters, matrix: [[1], [0], [1]]}]
    actuators[1]: a vehicle has one entry with thrusters; put all of them in the first one
actuators: [{kind: thrusters, thrusters: [{at: [0, 0, 0], along: [1, 0]}]}]
    actuators[0].thrusters[0].at: expected 2 numbers for SE2, got 3
actuators: [{kind: thrusters, thrusters: [{at: [0, 0], along: [0, 0]}]}]
    actuators[0].thrusters[0].along: expected a direction, got a vector of zeros
actuators: [{kind: thrusters, thrusters: [{at: [0, 0], along: [0, 1], turns: 0.1}]}]
    actuators[0].thrusters[0].turns: a torque about along has no part in the plane of SE2; remove
    this key
actuators: [{kind: thrusters, thrusters: [{at: [0, 0], along: [0, 1], name: a}, {at: [0, 0],
  along: [1, 0], name: a}]}]
    actuators[0].thrusters[1].name: expected a unique name, got 'a', which thrusters[0] has
actuators: [{kind: thrusters, thrusters: []}]
    actuators[0].thrusters: expected one thruster or more, got none
plant: {forces: [{kind: drag, linear: 1, current: [0.3, 0, 0]}]}
    plant.forces[0].current: expected 2 numbers or expressions for SE2, got 3
actuators: [{kind: thrusters, matrix: [[1], [0], [0]], moment_constant: 1, low: 0, high: 1}]
    actuators[0].moment_constant: applies to rotors only; add thrust_constant
actuators: [{kind: thrusters, matrix: [[1], [0], [0]], thrust_constant: 1}]
    actuators[0]: rotors need limits; give low_speed and high_speed, or low and high
actuators: [{kind: thrusters, matrix: [[1], [0], [0]], thrust_constant: 1, low: -1, high: 1}]
    actuators[0].low: a rotor pushes one way; expected at least 0, got -1
actuators: [{kind: thrusters, matrix: [[1], [0], [0]], thrust_constant: 1, low: 0, high: 1,
  high_speed: 3}]
    actuators[0].high_speed: give limits of the speed or of the thrust, not of both
actuators: [{kind: thrusters, matrix: [[1], [0], [0]], thrust_constant: 1, high_speed: 3}]
    actuators[0].low_speed: missing; give both limits, low_speed and high_speed
actuators: [{kind: thrusters, matrix: [[1], [0], [0]], thrust_constant: 1, low_speed: 3,
  high_speed: 3}]
    actuators[0].low_speed: expected a number less than high_speed, 3, got 3
actuators: [{kind: thrusters, matrix: [[1], [0], [0]], thrust_constant: 1, moment_constant: 1,
  low: 0, high: 1}]
    actuators[0].moment_constant: belongs to thrusters with places; a matrix has its torques in its
    rows
actuators: [{kind: thrusters, matrix: [[1], [0], [0]], thrust_constant: 0, low: 0, high: 1}]
    actuators[0].thrust_constant: expected a number greater than 0, got 0
""",
    "SE3": """
# Sensors of parts, with times of their own.
control: {period: 0.1}
sensors: {pose: [{kind: noise, std: 1, of: position}]}
    sensors.pose[0].of: SE3 has no part 'position'; choose one of rotation, translation
control: {period: 0.1}
sensors: {pose: [{kind: noise, std: [1, 1], of: translation}]}
    sensors.pose[0].std: expected 3 entries for the translation of SE3, got 2
control: {period: 0.1}
sensors: {pose: [{kind: noise, std: 1, dropout: 1.0}]}
    sensors.pose[0].dropout: expected a probability of at least 0 and less than 1, got 1
control: {period: 0.1}
sensors: {pose: [{kind: noise, std: 1, delay: 0.1}]}
    sensors.pose[0].delay: counts control periods, got 0.1; for a time write '0.1 s'
control: {period: 0.1}
sensors: {pose: [{kind: noise, std: -1}, {kind: noise, std: 1, period: 1, of: translation}, {kind:
  bias, period: 0.5}]}
    sensors.pose[0].std: expected a standard deviation of at least 0, got -1 |
    sensors.pose[2].period: entries of one part share their period: sensors.pose[1] gives 1 for the
    translation, and this entry 0.5; give it at one of them
# A broken section is not a missing one.
control: {period: 0.1, delay: 0.02}
sensors: {pose: [{kind: noise, std: 1, period: 0.25}]}
actuators: [{kind: limit, limit: -1}, {kind: rate_limit, rate: 1}]
    control.delay: counts control periods, got 0.02; for a time write '0.02 s' |
    actuators[0].limit: expected a number greater than 0, got -1
# An entry keeps its number where one before it is wrong.
actuators: [{kind: limit, limit: -1}, {kind: rate_limit, rate: 1}]
    actuators[0].limit: expected a number greater than 0, got -1 |
    actuators[1]: rate_limit acts at control instants; set control.period
""",
    "R1": """
control: {period: 0.1}
sensors: {pose: [{kind: lag, time_constant: 1}]}
    sensors.pose[0]: lag measures velocities; move it to sensors.velocity
control: {period: 0.1}
sensors: {velocity: [{kind: lag, time_constant: 0}]}
    sensors.velocity[0].time_constant: expected a number greater than 0, got 0
control: {period: 0.1}
sensors: {velocity: [{kind: lag, time_constant: [1, 2]}]}
    sensors.velocity[0].time_constant: expected 1 entries for R1, got 2
""",
}


@pytest.mark.parametrize(
    ("group", "sections", "said"),
    [(group, *case) for group, table in WRONG.items() for case in cases(table)],
)
def test_what_is_wrong_is_said_once_and_at_its_place(experiment, group, sections, said):
    given = (line.split(": ", 1) for line in sections.replace("\n  ", " ").splitlines())
    with pytest.raises(ConfigError) as caught:
        experiment(**{"group": group} | OTHERS[group] | dict(given))
    assert " | ".join(f"{each.path}: {each.message}" for each in caught.value.problems) == said
