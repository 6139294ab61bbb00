#!/usr/bin/env bash
# Every figure of the documentation from its experiment.
#
#   docs/figures/draw.sh draw    draw the pictures, and keep the numbers behind their curves
#   docs/figures/draw.sh check   compare the numbers with those that are kept
#   docs/figures/draw.sh check se3 sweep_lag    those of these experiments alone
#
# Two experiments are computed at a time. The exit code is 0 if all is well.
#
# The paper's experiment is run by both engines where both are installed: its numbers must agree within
# 1e-8. The others are run by the fast one, and left out where it is missing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

task=${1:?draw or check}
shift
eqt=${EQT:-eqt}
python=${PYTHON:-python}
place=docs/figures
built=build/figures
apart= within=
status=0

# experiment NAME CONFIG [OPTION...], sweep and worst likewise: run it; what follows is about it.
experiment() { computed run "$@"; }
sweep() { computed sweep "$@" --set solver.cross_check=0; }
worst() { computed worst "$@"; }
computed() {
	name=$2
	result=$built/$name
	"$eqt" "$1" "${@:3}" --out "$result" --force --quiet >/dev/null
}

# numbers FIGURE... [OPTION...]: keep or check the numbers behind the curves of these figures.
numbers() {
	local figures=()
	while [ $# -gt 0 ] && [ "${1#-}" = "$1" ]; do
		figures+=(--figure "$1")
		shift
	done
	local kept=$place/numbers/$name found=$built/numbers$apart/$name
	[ "$task" = check ] || found=$kept
	rm -rf "$built/numbers$apart/$name"
	"$eqt" plot "$result" "${figures[@]}" "$@" --format json --out "$found" --quiet
	[ "$task" = draw ] || "$python" $place/compare.py "$found" "$kept" $within || status=$?
}

# numbers_of_paper: those of every figure that the paper's experiment has; of single runs, a few runs
# show a change as well as many.
numbers_of_paper() {
	numbers paper summary distributions
	numbers torque
	name=${name}_feedforward numbers torque --option share=feedforward
}

# picture FILE FIGURE [OPTION...]: draw a figure as docs/figures/FILE.png.
picture() {
	if [ "$task" = draw ]; then
		"$eqt" plot "$result" --figure "$2" "${@:3}" --format png --out "$built/$name/figures" --quiet
		shrunk "$built/$name/figures/$2.png" "$place/$1.png"
	fi
}

# shrunk FILE COPY: a copy for the screen, at most 1400 pixels wide, with all its colours.
shrunk() {
	"$python" - "$@" <<-'END'
		import sys
		from PIL import Image
		picture = Image.open(sys.argv[1]).convert("RGB")
		picture.thumbnail((1400, picture.height), Image.Resampling.LANCZOS)
		picture.save(sys.argv[2], optimize=True)
	END
}

# followed KIND REFERENCE: the reference of this kind, which needs no run and no engine.
followed() {
	name=reference_$1
	result=configs/paper.yaml
	local changes=(--set "reference=$2" --set time.duration=20)
	numbers reference "${changes[@]}" --degrees
	picture "$name" reference "${changes[@]}" --degrees
}

references() {
	followed torque '{kind: torque, torque: ["cos(t)", "sin(t)", "cos(t)*sin(t)"]}'
	followed constant '{kind: constant, velocity: [0, 0.1, 0.3]}'
	followed rates '{kind: rates, rates: [0.3*cos(t), 0, 0.1]}'
	followed path '{kind: path, pose: {euler: {sequence: ZYX, angles: [30 deg, 0, 0]}}, factors: [
		{axis: wz, by: 0.3*sin(t)}, {axis: [1, 1, 0], by: "0.5*smoothstep(t, 2, 6)"}]}'
	followed slew '{kind: slew, to: {rotvec: [20 deg, -30 deg, 90 deg]}, start: 1.0, duration: 15.0}'
	followed waypoints '{kind: waypoints, points: [{t: 0, pose: identity},
		{t: 8, pose: {rotvec: [0, 0, 90 deg]}},
		{t: 20, pose: {quaternion: {wxyz: [0.5, 0.5, 0.5, 0.5]}}}]}'
}

paper() {
	experiment paper configs/paper.yaml
	"$eqt" plot "$result" --figure paper --format png --quiet
	"$python" $place/printed.py "$task" "$result" || status=$?
	numbers_of_paper
	picture paper paper
	picture summary summary
	picture torque torque --width page
	picture torque_feedforward torque --width page --option share=feedforward
	picture single_runs runs
	picture distributions distributions
	if [ "$task" = draw ]; then
		"$eqt" animate "$result" --run 1 --controller eqt --controller gt --seconds 6 \
			--out "$result/figures" --quiet
		cp "$result/figures/run1.gif" "$place/animation.gif"
	fi
}

paper_by_native() {
	if [ "$task" = check ]; then
		experiment paper_by_native configs/paper.yaml --engine native
		name=paper apart=_by_native within=1e-8 numbers_of_paper
	fi
}

# shipped NAME: what a shipped experiment shows of itself.
shipped() {
	experiment "$1" "configs/$1.yaml" --engine native
	numbers summary
	picture "$1" summary --width page
}
se3() { shipped se3; }
se2_vehicle() { shipped se2_vehicle; }
quadrotor_lee() {
	experiment quadrotor_lee configs/quadrotor_lee.yaml --engine native --set solver.cross_check=0
	numbers path pose --controller model --controller filter
	picture path path --option bodies=6 --width page
	picture pose pose
}
se3_bluerov2() { shipped se3_bluerov2; }
se23() { shipped se23; }
satellite_panels() { shipped satellite_panels; }

se3_bluerov2_thrusters() {
	experiment se3_bluerov2_thrusters configs/se3_bluerov2_thrusters.yaml --engine native \
		--set solver.error_estimate=false --set solver.cross_check=0
	numbers summary
	picture se3_bluerov2_thrusters summary --width page
}

se3_bluerov2_estimated() {
	experiment se3_bluerov2_estimated configs/se3_bluerov2_estimated.yaml --engine native \
		--set ensemble.runs=20 --set solver.cross_check=0
	numbers estimate --option 'controllers=[eqt, lee2010]'
	picture se3_bluerov2_estimated estimate --option 'controllers=[eqt, lee2010]' --width page
}

satellite_folding() {
	experiment satellite_folding configs/satellite_panels.yaml --engine native --set 'inertia={
		initial: [[24.0, 0, 1.2], [0, 4.0, 0], [1.2, 0, 28.0]],
		factor: [["1 - tanh(t/3)**2/2", 0, 0], [0, 1, 0], [0, 0, "1 - tanh(t/3)**2/2"]]}'
	numbers summary
	picture satellite_folding summary --width page
}

attitude_distinct() {
	experiment attitude_distinct configs/attitude_distinct.yaml --engine native
	numbers summary
	picture attitude_distinct runs
}

attitude_manifold() { # near the manifold of half-turns
	experiment attitude_manifold configs/paper.yaml --engine native \
		--set "initial.pose={kind: exp_normal, centre: [pi, 0, 0], std: 1e-3}" \
		--set initial.velocity=fixed --set ensemble.runs=100 --set ensemble.seed=3 \
		--set time.duration=40 --set time.samples=801
	numbers summary
	picture attitude_manifold runs
}

paper_rates() {
	experiment paper_rates configs/paper_rates.yaml --engine native --set ensemble.runs=2
	numbers rates
	picture rates rates
}

provable() { # of proofs, which figures of runs do not have
	if [ "$task" = draw ]; then "$python" $place/provable.py; fi
}

sweep_lag() {
	sweep sweep_lag configs/sweep_lag.yaml --engine native
	numbers settled
	picture sweep_lag settled
	picture winners winners
	name=sweep_lag_pooled numbers pooled --option metric=effort --controller eqt --controller gt
	picture pooled pooled --option metric=effort --controller eqt --controller gt
}

sweep_lqr() {
	sweep sweep_lqr configs/sweep_lqr.yaml --engine native
	numbers settled
	picture sweep_lqr settled --width page
}

sweep_region() {
	sweep sweep_region configs/sweep_region.yaml --engine native
	numbers settled
	picture sweep_region settled --width page
}

satellite_wheels() {
	experiment satellite_wheels configs/satellite_wheels.yaml --engine native --set ensemble.runs=2
	numbers commands --option run=1
	picture commands commands --option run=1 --to 20
}

keep_out() {
	experiment keep_out configs/cubesat_sun.yaml --engine native
	numbers keep_out
	picture keep_out keep_out
}

satellite_failures() {
	experiment satellite_failures configs/satellite_breaks.yaml --engine native --set store.trajectories=none
	numbers failures --width page
	picture satellite_failures failures --width page
}

satellite_breaks() {
	sweep satellite_breaks configs/satellite_breaks.yaml --engine native --set ensemble.runs=100 \
		--set store.trajectories=none --grid "initial.pose.angle=30 deg,90 deg,150 deg,180 deg" \
		--grid initial.velocity.speed=0,1,2,3,4
	numbers settled
	picture satellite_region settled --width page
	if [ "$task" = draw ]; then # The search takes five minutes of a core.
		worst satellite_worst configs/satellite_breaks.yaml --engine native --set ensemble.runs=5
		numbers worst --width page
		picture satellite_worst worst --width page
	fi
}

sweep_family() {
	sweep sweep_family configs/sweep_family.yaml --engine native
	numbers sweep
	picture sweep_family sweep
}

fronts() {
	if [ "$task" = draw ]; then # The search takes 75 s of CPU time.
		computed tune fronts configs/tune_paper.yaml --engine native --set tune.objective=null \
			--set "tune.objectives=[effort, mean_pose_error]" --set tune.equal={} --set tune.population=16 --set tune.budget=256
		picture fronts fronts --width page
		picture equal_effort fronts --controller eqt --controller gt
	fi
}

quadrotor_recovery() {
	sweep quadrotor_recovery configs/quadrotor_recovery.yaml --engine native
	numbers sweep
	picture quadrotor_recovery sweep
}

if [ $# = 1 ]; then # printed as a whole, since another is computed beside it
	set +e
	said=$(
		set -e
		"$1" 2>&1
		exit "$status"
	)
	status=$?
	printf '%s\n%s\n' "$1" "$said"
	exit "$status"
fi
# The longest first.
all=(paper references)
if "$python" -c 'import sys; from eqt_cli.engines.native import Native as n; sys.exit(bool(n.unavailable()))'; then
	all=(provable fronts se3_bluerov2_thrusters se3_bluerov2_estimated paper paper_by_native references se3 se3_bluerov2 sweep_region sweep_lqr
		satellite_breaks satellite_failures keep_out quadrotor_lee se2_vehicle se23 satellite_panels satellite_folding attitude_distinct
		attitude_manifold sweep_lag satellite_wheels paper_rates sweep_family quadrotor_recovery)
elif [ $# = 0 ]; then
	echo "there is no C compiler: the other experiments are left out"
fi
[ $# = 0 ] && set -- "${all[@]}"
printf '%s\n' "$@" | xargs -P 2 -n 1 "$BASH" docs/figures/draw.sh "$task"
