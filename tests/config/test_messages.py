"""What is said of a configuration that is wrong, word by word, and where.

Every case changes sections of the configuration in small_experiment.py, whose sections stand on
lines of their own; a new section is line 10. Of places, the tables leave out the file.
"""

import pytest
from said import said_of, sections_of

from eqt_cli.components.laws import controllers
from eqt_cli.components.references import references


def names(registry):
    return ", ".join(registry.names())


def in_file(said):
    return "\n".join(f"c.yaml:{line}" for line in said.splitlines())


SAID = said_of(r"""
# Unknown keys.
gian: 1 → 10:1: gian: unknown key; did you mean 'gains'?
grup: SO3 → 10:1: grup: unknown key; did you mean 'group'?
gains: {kp: 1, kd: 1, Kd: 2} → 3:23: gains.Kd: unknown key; did you mean 'kd'?
ensemble: {run: 5} → 7:12: ensemble.run: unknown key; did you mean 'runs'?
time: {duration: 1, sample: 5} → 8:21: time.sample: unknown key; did you mean 'samples'?
store: {trajectory: all} → 10:9: store.trajectory: unknown key; did you mean 'trajectories'?
initial: {poses: haar} → 6:11: initial.poses: unknown key; did you mean 'pose'?
target: {pse: identity} →
    10:1: target: is a key of task: stabilise; give a reference for task: track
    10:10: target.pse: unknown key; did you mean 'pose'?
controllers: [{kind: family, giroscopic: 1}] →
    5:30: controllers[0].giroscopic: unknown key; did you mean 'gyroscopic'?
controllers: [{kind: eqt, lable: a}] →
    5:27: controllers[0].lable: unknown key; did you mean 'label'?
controllers: [{kind: eqt, gyroscopic: 1}] →
    5:27: controllers[0].gyroscopic: unknown key; expected one of kind, label, gains
reference: {kind: constant, velocty: 1} →
    4:29: reference.velocty: unknown key; did you mean 'velocity'?
reference: {kind: constant, torque: [0, 0, 0]} →
    4:29: reference.torque: unknown key; expected one of kind, pose, velocity
solver: {rtoll: 1} → 9:10: solver.rtoll: unknown key; did you mean 'rtol'?
initial: {pose: {kind: haar, sequence: ZYX}} →
    6:30: initial.pose.sequence: unknown key; expected one of kind, position, velocity
initial: {pose: {kind: haar, position: {sdt: 1}}} →
    6:30: initial.pose.position: SO3 has no position column, since it has no translations; remove
        this key
    6:41: initial.pose.position.sdt: unknown key; did you mean 'std'?
kp: 2 → 10:1: kp: unknown key; did you mean 'gains.kp'?
inertia: {matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], initial: 1} →
    2:54: inertia.initial: unknown key; expected one of rigid, added, factor, matrix
time: {durations: 1} → 8:8: time.durations: unknown key; did you mean 'duration'?
gains: {kp: 1, kdd: 1} → 3:16: gains.kdd: unknown key; did you mean 'kd'?
controllers: [eqq] → 5:15: controllers[0]: unknown controller 'eqq'; did you mean 'eqt'?
controllers: [{kind: eqq}] →
    5:16: controllers[0].kind: unknown controller 'eqq'; did you mean 'eqt'?
reference: {kind: konstant} →
    4:13: reference.kind: unknown reference 'konstant'; did you mean 'constant'?
initial: {pose: harr} → 6:11: initial.pose: unknown pose distribution 'harr'; did you mean 'haar'?
initial: {velocity: {kind: nomal}} →
    6:22: initial.velocity.kind: unknown velocity distribution 'nomal'; did you mean 'normal'?
solver: {engine: solveivp} →
    9:10: solver.engine: unknown engine 'solveivp'; did you mean 'solve_ivp'?
group: SO4 →
    1:1: group: unknown group 'SO4', so the numbers of inertia, gains, reference, controllers,
        initial were not checked; did you mean 'SO3'?
group: Q →
    1:1: group: unknown group 'Q', so the numbers of inertia, gains, reference, controllers, initial
        were not checked; known: R1, R3, SE2, SE23, SE3, SO2, SO3 and products such as SO3*R3
# Sections without a value are left out.
group →
    1:1: group: missing; this key is required: The configuration space: SO3, SE3, … (`eqt list
        groups`)
inertia →
    1:1: inertia: missing; this key is required: Inertia tensor 𝕀: scalar, diagonal, m×m matrix, a
        rigid and an added part, or varying in time
gains →
    1:1: gains: missing; this key is required: Gains of the control laws, for example gains: {kp: 1,
        kd: 1}
controllers →
    1:1: controllers: missing; this key is required: Control laws to compare, from the same initial
        states (`eqt list controllers`)
time →
    1:1: time: missing; this key is required: The horizon and its samples, for example time:
        {duration: 20}
reference → 1:1: reference: missing; task: track needs a reference to follow
gains: {kd: 1} →
    3:8: gains.kp: missing; this key is required: Navigation weight K of Υ(Q) = ½ tr((Q − I) K (Q −
        I)ᵀ): scalar, diagonal or d×d matrix; for a product of groups also a list with one of these
        per factor
gains: {kp: 1} →
    3:8: gains.kd: missing; this key is required: Rayleigh tensor K_d, positive definite: scalar,
        diagonal or m×m matrix
time: {samples: 5} → 8:7: time.duration: missing; this key is required: Length of the horizon, s
reference: {} →
    4:12: reference.torque: missing; this key is required: m expressions in t, body frame: forces
        dual to the velocity coordinates
inertia: {factor: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]} →
    2:10: inertia.initial: missing; this key is required: 𝕀_0, symmetric positive definite
# Wrong types.
group: 3 → 1:1: group: expected text, got 3
group: null → 1:1: group: expected text, got null
inertia: null →
    2:1: inertia: expected a number, a list (the diagonal), a list of rows, or a mapping with
        `rigid` and `added`, with `initial` and `factor`, or with `matrix`, got null
inertia: true →
    2:1: inertia: expected a number, a list (the diagonal), a list of rows, or a mapping with
        `rigid` and `added`, with `initial` and `factor`, or with `matrix`, got true
inertia: {mass: 1} →
    2:1: inertia: expected a number, a list (the diagonal), a list of rows, or a mapping with
        `rigid` and `added`, with `initial` and `factor`, or with `matrix`, got {mass: 1}
inertia: [1, .inf, 2] → 2:14: inertia[1]: expected a finite number, got .inf
inertia: [[1, 0, 0], 4, 5] →
    2:22: inertia[1]: expected a list, got 4
    2:25: inertia[2]: expected a list, got 5
gains: 1 → 3:1: gains: expected a mapping, got 1
gains: {kp: true, kd: 1} →
    3:9: gains.kp: expected a number, a list (the diagonal) or a list of rows, got true
gains: {kp: {a: 1}, kd: 1} →
    3:9: gains.kp: expected a number, a list (the diagonal) or a list of rows, got {a: 1}
reference: constant → 4:1: reference: expected a mapping, got 'constant'
reference: {torque: "cos(t)"} →
    4:13: reference.torque: expected a list, such as [cos(t)], got 'cos(t)'
reference: {torque: [null, true, [1]]} →
    4:22: reference.torque[0]: expected text or a number, got null
    4:28: reference.torque[1]: expected text or a number, got true
    4:34: reference.torque[2]: expected text or a number, got [1]
reference: {kind: constant, pose: null} →
    4:29: reference.pose: expected identity, a 3×3 matrix or {rotvec: …} for SO3 (quaternion, euler
        or matrix may replace rotvec), got null
reference: {kind: constant, pose: 3} →
    4:29: reference.pose: expected identity, a 3×3 matrix or {rotvec: …} for SO3 (quaternion, euler
        or matrix may replace rotvec), got 3
reference: {kind: constant, pose: [1, 2, 3]} →
    4:36: reference.pose[0]: expected a list, got 1
    4:39: reference.pose[1]: expected a list, got 2
    4:42: reference.pose[2]: expected a list, got 3
reference: {kind: constant, velocity: null} →
    4:29: reference.velocity: expected a number or a list, got null
controllers: eqt → 5:1: controllers: expected a list, such as [eqt], got 'eqt'
controllers: -3; gains → 4:1: controllers: expected a list, got -3
controllers: [eqq]; gains → 4:15: controllers[0]: unknown controller 'eqq'; did you mean 'eqt'?
reference: {to: identity, duration: 3} →
    4:12: reference.kind: missing; these keys are those of kind: slew
controllers: [] → 5:1: controllers: expected at least 1 entry, got []
controllers: [3] → 5:15: controllers[0]: expected text or a mapping, got 3
controllers: [{kind: eqt, label: 3}] → 5:27: controllers[0].label: expected text on one line, got 3
controllers: [{kind: eqt, label: ''}] →
    5:27: controllers[0].label: expected text on one line, got ''
controllers: [{kind: eqt, label: "a\0b"}] →
    5:27: controllers[0].label: expected text on one line, got 'a\x00b'
controllers: [{kind: family, damping: sideways}] →
    5:30: controllers[0].damping: expected 'spatial' or 'body', got 'sideways'
initial: 3 → 6:1: initial: expected a mapping, got 3
initial: {pose: 3} → 6:11: initial.pose: expected text or a mapping, got 3
initial: {pose: {kind: haar, position: 1}} → 6:30: initial.pose.position: expected a mapping, got 1
ensemble: {runs: 1.5} → 7:12: ensemble.runs: expected a whole number, got 1.5
ensemble: {runs: true} → 7:12: ensemble.runs: expected a whole number, got true
ensemble: {runs: '2'} → 7:12: ensemble.runs: expected a whole number, got '2'
ensemble: {runs: 0} → 7:12: ensemble.runs: expected a whole number of at least 1, got 0
ensemble: {seed: -1} → 7:12: ensemble.seed: expected a whole number of at least 0, got -1
ensemble: {seed: 9223372036854775808} →
    7:12: ensemble.seed: expected a whole number less than 9223372036854775808, got
        9223372036854775808
time: {duration: null} → 8:8: time.duration: expected a number, got null
time: {duration: .nan} → 8:8: time.duration: expected a finite number, got .nan
time: {duration: 1.0e-13} → 8:8: time.duration: expected at least 1e-12 s, got 1e-13
time: {duration: 1, samples: 5.0} → 8:21: time.samples: expected a whole number, got 5.0
solver: rk45 → 9:1: solver: expected a mapping, got 'rk45'
solver: {engine: 3} → 9:10: solver.engine: expected the name of an engine, got 3
solver: {method: RK4} →
    9:10: solver.method: expected 'DOP853', 'RK45', 'RK23', 'Radau', 'BDF' or 'LSODA', got 'RK4'
solver: {rtol: [1]} → 9:10: solver.rtol: expected a number, got [1]
solver: {block: 0} → 9:10: solver.block: expected a whole number of at least 1, got 0
solver: {cross_check: -1} → 9:10: solver.cross_check: expected a whole number of at least 0, got -1
store: {trajectories: some} →
    10:9: store.trajectories: expected 'all', 'none' or a whole number, got 'some'
store: {trajectories: -1} →
    10:9: store.trajectories: expected 'all', 'none' or a whole number of at least 0, got -1
store: {decimate: 0} → 10:9: store.decimate: expected a whole number of at least 1, got 0
store: {compression: zip} → 10:9: store.compression: expected 'none' or 'gzip', got 'zip'
settling_threshold: 0 → 10:1: settling_threshold: expected a number greater than 0, got 0
settling_threshold: [1] →
    10:1: settling_threshold: expected a number, an angle such as 2 deg, or {part: threshold, …},
        got [1]
settling_threshold: {rotation: 200 deg} →
    10:22: settling_threshold.rotation: expected an angle of at most 180 deg, got 200 deg
settling_threshold: {rotatoin: 2 deg} →
    10:22: settling_threshold.rotatoin: unknown key; did you mean 'rotation'?
name: 3 → 10:1: name: expected text, got 3
name: ../up →
    10:1: name: expected letters, digits, '.', '_' and '-', with a letter or digit first and no '.'
        last, got '../up'
name: paper. →
    10:1: name: expected letters, digits, '.', '_' and '-', with a letter or digit first and no '.'
        last, got 'paper.'
plugins: law.py → 10:1: plugins: expected a list of paths to Python files, got 'law.py'
plugins: [3] → 10:11: plugins[0]: expected the path of a Python file, got 3
task: stabilize → 10:1: task: expected 'track' or 'stabilise', got 'stabilize'
# Wrong shapes.
inertia: [[1, 2, 3], [4, 5, 6]] → 2:1: inertia: expected 3×3 for SO3, got 2×3
inertia: [1, 2] → 2:1: inertia: expected 3 diagonal entries for SO3, got 2
inertia: [] → 2:1: inertia: expected 3 diagonal entries for SO3, got 0
inertia: [[1, 2], [3, 4, 5], [1]] →
    2:1: inertia: expected rows of equal length, got rows of 2, 3, 1 entries
gains: {kp: [[1, 0, 0], 2], kd: 1} →
    3:9: gains.kp: expected rows, or numbers of the diagonal, got both: 2
inertia: {matrix: [[1, 0, 0], [0, 1, 0]]} → 2:11: inertia.matrix: expected 3×3 for SO3, got 2×3
gains: {kp: 1, kd: [1, 2]} → 3:16: gains.kd: expected 3 diagonal entries for SO3, got 2
gains: {kp: [[1, 0], [0, 1]], kd: 1} → 3:9: gains.kp: expected 3×3 for SO3, got 2×2
reference: {torque: ["cos(t)", "sin(t)"]} →
    4:13: reference.torque: expected 3 expressions for SO3, got 2
reference: {kind: constant, velocity: [1, 2]} →
    4:29: reference.velocity: expected 3 entries for SO3, got 2
reference: {kind: constant, pose: [[1, 0, 0], [0, 1, 0]]} →
    4:29: reference.pose: expected 3×3 for SO3, got 2×3
reference: {kind: constant, pose: {rotvec: [1, 2]}} →
    4:36: reference.pose.rotvec: expected 3 entries for SO3, got 2
initial: {pose: {kind: fixed, coordinates: [1, 2]}} →
    6:31: initial.pose.coordinates: expected 3 numbers for SO3, got 2
initial: {velocity: {kind: fixed, coordinates: [1, 2]}} →
    6:35: initial.velocity.coordinates: expected 3 numbers for SO3, got 2
initial: {velocity: {kind: normal, std: [1, 2]}} →
    6:36: initial.velocity.std: expected a number or a list of 3, got a list of 2
initial: {pose: [haar]} → 6:11: initial.pose: expected one distribution, got a list of 1
# Tensors that will not do.
inertia: [[1, 0.1, 0], [0.2, 1, 0], [0, 0, 1]] →
    2:1: inertia: expected a symmetric matrix, got [0][1] = 0.1 but [1][0] = 0.2
inertia: [[1, 2, 0], [2, 1, 0], [0, 0, 1]] →
    2:1: inertia: expected a positive definite matrix, got eigenvalues -1, 1, 3
inertia: -1 → 2:1: inertia: expected a positive definite matrix, got eigenvalues -1, -1, -1
inertia: [1, 0, 1] → 2:1: inertia: expected a positive definite matrix, got eigenvalues 0, 1, 1
inertia: [[0.1, 0.2, 0.3], [0.2, 0.4, 0.6], [0.3, 0.6, 0.9]] →
    2:1: inertia: expected a positive definite matrix, got eigenvalues 0, 0, 1.4
inertia: {matrix: [['1 - t', 0, 0], [0, 1, 0], [0, 0, 1]]} →
    2:1: inertia: at t = 1 s: expected a positive definite matrix, got eigenvalues 0, 1, 1
# Between two instants of the grid.
inertia: {initial: 1, factor: [['1 - t/0.732345', 0, 0], [0, 1, 0], [0, 0, 1]]} →
    2:1: inertia: at t = 0.732345 s: expected a positive definite matrix, got the eigenvalue 0
inertia: {initial: 1, factor: [[1-t/0.732345,0,0], [0,1-t/0.732345,0], [0,0,1-t/0.732345]]} →
    2:1: inertia: at t = 0.732345 s: expected a positive definite matrix, got the eigenvalue 0
inertia: {matrix: [['(1 - t/0.732345)**2', 0, 0], [0, 1, 0], [0, 0, 1]]} →
    2:1: inertia: at t = 0.732345 s: expected a positive definite matrix, got the eigenvalue 0
# At an instant.
inertia: {matrix: [[1, t, 0], [0, 1, 0], [0, 0, 1]]} →
    2:1: inertia: at t = 0.001 s: expected a symmetric matrix, got [0][1] = 0.001 but [1][0] = 0
inertia: {matrix: [['1/t', 0, 0], [0, 1, 0], [0, 0, 1]]} →
    2:1: inertia: at t = 0 s: expected finite entries, got [0][0] = inf
inertia: {initial: 1, factor: [['1 + t', 0, 0], [0, 1, 0], [0, 0, 2]]} →
    2:23: inertia.factor: expected the identity at t = 0, got [2][2] = 2
inertia: {initial: [1, -1, 1], factor: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]} →
    2:11: inertia.initial: expected a positive definite matrix, got eigenvalues -1, 1, 1
gains: {kp: 1, kd: 0} → 3:16: gains.kd: expected a positive definite matrix, got eigenvalues 0, 0, 0
gains: {kp: 1, kd: [1, -2, 3]} →
    3:16: gains.kd: expected a positive definite matrix, got eigenvalues -2, 1, 3
gains: {kp: 1, kd: [[1, 5, 0], [0, 1, 0], [0, 0, 1]]} →
    3:16: gains.kd: expected a positive definite matrix, got eigenvalues -1.5, 1, 3.5
gains: {kp: [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]], kd: 1} →
    3:9: gains.kp: expected a symmetric matrix, got [0][1] = 0.5 but [1][0] = 0
gains: {kp: [1, -1, 1], kd: 1} →
    3:9: gains.kp: must be positive, so that small errors on SO3 have a positive stiffness (on SO3:
        every sum of two eigenvalues); got the stiffness 0, 0, 2
gains: {kp: [3, 1, -2], kd: 1} →
    3:9: gains.kp: must be positive, so that small errors on SO3 have a positive stiffness (on SO3:
        every sum of two eigenvalues); got the stiffness -1, 1, 4
# Expressions.
inertia: pii →
    2:1: inertia: expected a number, got 'pii': unknown name 'pii' at column 1; did you mean 'pi'?
gains: {kp: 1/0, kd: 1} → 3:9: gains.kp: expected a number, got '1/0': division by zero at column 2
reference: {torque: ["cos(t", "sin t", "2 t"]} →
    4:22: reference.torque[0]: 'cos(t': the '(' at column 4 is never closed
    4:31: reference.torque[1]: 'sin t': function 'sin' at column 1 needs its argument in
        parentheses, as in 'sin(t)'
    4:40: reference.torque[2]: '2 t': missing operator between '2' and 't' at column 3; write '2*t'
        to multiply
reference: {torque: ["", "t +", "1/0"]} →
    4:22: reference.torque[0]: '': expected an expression at column 1, got an empty text
    4:26: reference.torque[1]: 't +': expected a number, a name or '(' at column 4, but the
        expression ends
    4:33: reference.torque[2]: '1/0': division by zero at column 2
reference: {torque: ["sen(t)", "t^2", "sqrt(-1)"]} →
    4:22: reference.torque[0]: 'sen(t)': unknown name 'sen' at column 1; did you mean 'sin'?
    4:32: reference.torque[1]: 't^2': unexpected character '^' at column 2; write '**' for a power
    4:39: reference.torque[2]: 'sqrt(-1)': 'sqrt' at column 1 has no finite value (got nan)
inertia: {matrix: [[1, 0, 0], [0, '1 + coss(t)', 0], [0, 0, 1]]} →
    2:35: inertia.matrix[1][1]: '1 + coss(t)': unknown name 'coss' at column 5; did you mean 'cos'?
initial: {pose: {kind: euler, low: -pi, high: pii}} →
    6:41: initial.pose.high: expected a number, got 'pii': unknown name 'pii' at column 1; did you
        mean 'pi'?
time: {duration: 2*pii} →
    8:8: time.duration: expected a number, got '2*pii': unknown name 'pii' at column 3; did you mean
        'pi'?
# What follows a number without an operator: a unit, a factor, or neither.
initial: {pose: {kind: euler, low: -180 ms}} →
    6:31: initial.pose.low: expected a number or an angle in rad, mrad, deg, arcmin or arcsec, got
        '-180 ms', which is -0.18 s
reference: {kind: constant, velocity: 90 m/s} →
    4:29: reference.velocity: expected a number or an angular velocity in rad/s, deg/s or rpm, got
        '90 m/s'
solver: {rtol: 10 arcsec} →
    9:10: solver.rtol: expected a number that has no unit, got '10 arcsec', which is 4.84814e-05 rad
time: {duration: 20 fortnights} →
    8:8: time.duration: expected a number or a time in s, ms, us, min or h, got '20 fortnights'
time: {duration: 2pi} →
    8:8: time.duration: expected a number, got '2pi': missing operator between '2' and 'pi' at
        column 2; write '2*pi' to multiply
time: {duration: 0x1G} →
    8:8: time.duration: expected a number, got '0x1G': missing operator between '0' and 'x1G' at
        column 2
# Traps of YAML.
time: {duration: 12:30} →
    8:8: time.duration: expected a number, got '12:30': unexpected character ':' at column 3
time: {duration: 1_000} →
    8:8: time.duration: expected a number, got '1_000': missing operator between '1' and '_000' at
        column 2
gains: {kp: 017, kd: 1} → 3:13: gains.kp: 017 is ambiguous: write 17 or 0o17
solver: {error_estimate: on} → 9:10: solver.error_estimate: expected true or false, got 'on'
store: {compression: no} → 10:9: store.compression: expected 'none' or 'gzip', got 'no'
reference: {torque: [1, 2, 3], torque: [0, 0, 0]} →
    4:32: reference.torque: duplicate key; the first is at c.yaml:4:13
gains: {kp: &a [*a], kd: 1} → 3:17: gains.kp[0]: *a is part of what it refers to
inertia: !!python/name:os.system →
    2:10: inertia: tag !!python/name:os.system is not allowed; write the value without it
# Values out of place.
target: {pose: identity} →
    10:1: target: is a key of task: stabilise; give a reference for task: track
initial: {pose: {kind: euler, sequence: ZZX}} →
    6:31: initial.pose.sequence: expected three axes such as ZYX (intrinsic) or xyz (extrinsic), got
        'ZZX'
initial: {pose: {kind: euler, low: 1, high: 0}} →
    6:31: initial.pose.low: expected at most 0, the value of high, got 1
initial: {velocity: {kind: normal, std: -1}} →
    6:36: initial.velocity.std: expected a standard deviation of at least 0, got -1
initial: {pose: {kind: haar, position: {std: 1}}} →
    6:30: initial.pose.position: SO3 has no position column, since it has no translations; remove
        this key
time: {duration: 0} → 8:8: time.duration: expected a number greater than 0, got 0
time: {duration: -1, samples: 1} →
    8:8: time.duration: expected a number greater than 0, got -1
    8:22: time.samples: expected a whole number of at least 2, got 1
solver: {rtol: 0} → 9:10: solver.rtol: expected a number greater than 0, got 0
solver: {rtol: 1e-20} →
    9:10: solver.rtol: expected a number from 2.22e-14 (SciPy's smallest) to 1, got 1e-20
solver: {engine: native, rtol: 1e-20} →
    9:26: solver.rtol: expected a number from 2.22e-13 to 1, got 1e-20
controllers: [eqt, eqt] →
    5:20: controllers[1]: an earlier controller has the label 'eqt'; give this one another `label`
controllers: [{kind: eqt, label: a}, {kind: gt, label: a}] →
    5:38: controllers[1]: an earlier controller has the label 'a'; give this one another `label`
controllers: [{kind: eqt, label: Own}, {kind: gt, label: oWN}] →
    5:40: controllers[1]: an earlier controller has the label 'Own'; give this one another `label`
        than 'oWN': capitals do not count
reference: {kind: constant, pose: [[1, 0, 0], [0, 2, 0], [0, 0, 1]]} →
    4:29: reference.pose: expected an element of SO3, got a matrix that is 3 away from one (rounding
        may leave 1e-09); write all digits, or give identity, a 3×3 matrix or {rotvec: …} for SO3
        (quaternion, euler or matrix may replace rotvec)
reference: {kind: constant, pose: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]} →
    4:29: reference.pose: expected an element of SO3, got a matrix that is 2 away from one (rounding
        may leave 1e-09); write all digits, or give identity, a 3×3 matrix or {rotvec: …} for SO3
        (quaternion, euler or matrix may replace rotvec)
reference: {kind: constant, pose: [[1, 0, 0], [0, 0.999999, 0], [0, 0, 1]]} →
    4:29: reference.pose: expected an element of SO3, got a matrix that is 2e-06 away from one
        (rounding may leave 1e-09); write all digits, or give identity, a 3×3 matrix or {rotvec: …}
        for SO3 (quaternion, euler or matrix may replace rotvec)
reference: {kind: constant, pose: {position: [1, 2, 3]}} →
    4:36: reference.pose.position: unknown key; a pose of SO3 takes rotvec, quaternion, euler,
        matrix
group: SO3*R3 →
    2:1: inertia: expected 6 diagonal entries for SO3*R3, got 3
    4:13: reference.torque: expected 6 expressions for SO3*R3, got 3
    6:17: initial.pose.kind: haar needs a group with rotations; for SO3*R3 use exp_normal, or a list
        of 2, one per factor
# Other groups and tasks.
group: SE2; gains: {kp: [1, 1, 0], kd: 1}; reference: {kind: constant}; initial: {} →
    3:9: gains.kp: must be positive, so that small errors on SE2 have a positive stiffness (on SO3:
        every sum of two eigenvalues); got the stiffness 0, 0, 2
group: SE2; initial: {pose: euler} →
    6:17: initial.pose.kind: euler needs rotations in three dimensions; for SE2 use haar or
        exp_normal
task: stabilise; controllers: [stabilising] →
    4:1: reference: is a key of task: track; give a target for task: stabilise
task: stabilise; controllers: [stabilising]; reference; target: {pose: {rotvec: [0, 0, pii]}} →
    10:32: target.pose.rotvec[2]: expected a number, got 'pii': unknown name 'pii' at column 1; did
        you mean 'pi'?
solver: {engine: native, method: fast, block: abs} →
    9:26: solver.method: expected 'DOP853', 'RK45', 'RK23', 'Radau', 'BDF' or 'LSODA', got 'fast'
    9:40: solver.block: expected a whole number, got 'abs'
""")


@pytest.mark.parametrize(("line", "said"), SAID.items())
def test_what_is_said_of_a_line(message, line, said):
    assert message(**sections_of(line)) == in_file(said)


def test_an_unknown_component(message):
    said = "5:15: controllers[0]: unknown controller 'wholly_new'; known: "
    assert message(controllers="[wholly_new]") == in_file(said + names(controllers))


def test_a_kind_that_is_missing(message):
    assert message(controllers="[{label: a}]") == (
        "c.yaml:5:15: controllers[0].kind: missing; expected a controller, one of "
        f"{names(controllers)}"
    )


def test_a_kind_that_is_no_text(message):
    assert message(reference="{kind: 3}") == (
        f"c.yaml:4:13: reference.kind: expected a reference, one of {names(references)}, got 3"
    )


def test_controllers_of_another_task(message):
    tracking = [kind.name for kind in controllers.all() if "track" in kind.tasks]
    assert message(controllers="[stabilising]") == (
        "c.yaml:5:15: controllers[0]: stabilising is a law for task: stabilise; for "
        f"task: track use {', '.join(tracking)}"
    )


def test_shapes_are_those_of_the_group(message):
    assert message(
        group="SE3",
        inertia="[1, 2]",
        gains="{kp: [1], kd: [[1, 0], [0, 1]]}",
        reference="{torque: [1], pose: {rotvec: 1, position: [1]}, velocity: [1]}",
        initial="{pose: {kind: euler, velocity: {std: 1}, position: {std: [1]}}}",
    ).splitlines() == [
        "c.yaml:2:1: inertia: expected 6 diagonal entries for SE3, got 2",
        "c.yaml:3:9: gains.kp: expected 4 diagonal entries for SE3, got 1",
        "c.yaml:3:18: gains.kd: expected 6×6 for SE3, got 2×2",
        "c.yaml:4:13: reference.torque: expected 6 expressions for SE3, got 1",
        "c.yaml:4:44: reference.pose.position: expected 3 entries for SE3, got 1",
        "c.yaml:4:60: reference.velocity: expected 6 entries for SE3, got 1",
        "c.yaml:6:31: initial.pose.velocity: SE3 has no velocity column, only position; remove "
        "this key",
        "c.yaml:6:62: initial.pose.position.std: expected a number or a list of 3, got a list of 1",
    ]


PRODUCT = {
    "group": "SO3*R3",
    "inertia": "1",
    "gains": "{kp: 1, kd: 1}",
    "reference": "{kind: constant}",
    "initial": "{}",
}
SAID_OF_A_PRODUCT = said_of("""
gains: {kp: [1, 2, 3], kd: 1} → 3:9: gains.kp: expected 2 entries, one per factor of SO3*R3, got 3
gains: {kp: [1, [[1, 0], [0, 1]]], kd: 1} → 3:9: gains.kp: entry 1: expected 4×4 for R3, got 2×2
initial: {pose: [haar]} →
    6:11: initial.pose: expected 2 entries, one per factor of SO3*R3, got a list of 1
initial: {pose: [haar, haar]} →
    6:24: initial.pose[1].kind: haar needs a group with rotations; for R3 use exp_normal
reference: {kind: constant, pose: [identity]} →
    4:29: reference.pose: expected identity, a 7×7 matrix, or a list of 2 poses for SO3*R3, got a
        list of 1
reference: {kind: constant, pose: {rotvec: 1}} →
    4:29: reference.pose: expected identity, a 7×7 matrix, or a list of 2 poses for SO3*R3, got
        {rotvec: 1}
reference: {kind: constant, pose: [identity, {rotvec: 1}]} →
    4:47: reference.pose[1].rotvec: unknown key; a pose of R3 takes position
""")


@pytest.mark.parametrize(("line", "said"), SAID_OF_A_PRODUCT.items())
def test_a_product_of_groups(message, line, said):
    assert message(**PRODUCT | sections_of(line)) == in_file(said)


def test_everything_is_reported_in_the_order_of_the_file(message):
    assert message(
        inertia="[[1, 2, 3], [4, 5, 6]]",
        gains="{kp: pii, kd: 0, Ki: 1}",
        reference='{torque: ["cos(t", "1", "2"], pose: [[1, 0, 0]], velocty: 1}',
        controllers="[eqt, eqt, 3]",
        initial="{pose: 3, velocity: {kind: normal, std: -1}}",
        time="{duration: -1, samples: 1}",
        solver="{method: RK4, rtoll: 1, rtol: 2}",
        store="{decimate: 0}",
        gian="1",
    ).splitlines() == [
        "c.yaml:2:1: inertia: expected 3×3 for SO3, got 2×3",
        "c.yaml:3:9: gains.kp: expected a number, got 'pii': unknown name 'pii' at column 1; "
        "did you mean 'pi'?",
        "c.yaml:3:18: gains.kd: expected a positive definite matrix, got eigenvalues 0, 0, 0",
        "c.yaml:3:25: gains.Ki: unknown key; expected one of kp, kd, k_R, k_Omega",
        "c.yaml:4:22: reference.torque[0]: 'cos(t': the '(' at column 4 is never closed",
        "c.yaml:4:42: reference.pose: expected 3×3 for SO3, got 1×3",
        "c.yaml:4:61: reference.velocty: unknown key; did you mean 'velocity'?",
        "c.yaml:5:20: controllers[1]: an earlier controller has the label 'eqt'; give "
        "this one another `label`",
        "c.yaml:5:25: controllers[2]: expected text or a mapping, got 3",
        "c.yaml:6:11: initial.pose: expected text or a mapping, got 3",
        "c.yaml:6:45: initial.velocity.std: expected a standard deviation of at least 0, got -1",
        "c.yaml:8:8: time.duration: expected a number greater than 0, got -1",
        "c.yaml:8:22: time.samples: expected a whole number of at least 2, got 1",
        "c.yaml:9:10: solver.method: expected 'DOP853', 'RK45', 'RK23', 'Radau', 'BDF' or "
        "'LSODA', got 'RK4'",
        "c.yaml:9:23: solver.rtoll: unknown key; did you mean 'rtol'?",
        "c.yaml:10:9: store.decimate: expected a whole number of at least 1, got 0",
        "c.yaml:11:1: gian: unknown key; did you mean 'gains'?",
    ]
