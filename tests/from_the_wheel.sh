#!/usr/bin/env bash
# Installs a wheel without extras into an environment of its own, outside the repository, runs there what a user runs first, without
# a network where this system can take it away, and reads the messages about extras that are missing.
# Usage: from_the_wheel.sh WHEEL [OPTION OF PIP...]
set -euo pipefail
wheel=$(realpath "$1")
repository=$(realpath "$(dirname "${BASH_SOURCE[0]}")/..")
shift
here=$(mktemp -d)
trap 'rm -rf "$here"' EXIT
"${PYTHON:-python3}" -m venv "$here/venv"
"$here/venv/bin/python" -m pip install --quiet --disable-pip-version-check "$@" "$wheel"
cd "$here"
unset PYTHONPATH
export HOME=$here PATH=$here/venv/bin:$PATH

offline=()
if unshare --user --map-root-user --net true 2>/dev/null; then
	offline=(unshare --user --map-root-user --net)
else
	echo "the network stays: this system does not let a user take it away"
fi

try() {
	echo "eqt $*"
	"${offline[@]}" eqt "$@" >out 2>&1 || { cat out; echo "eqt $*: failed"; exit 1; }
}

# refused TEXT COMMAND...: the command fails and its message holds the text
refused() {
	local text=$1
	shift
	if "${offline[@]}" "$@" >out 2>&1 || ! tr '\n' ' ' <out | grep -qF -- "$text"; then
		cat out
		echo "$*: expected a message with: $text"
		exit 1
	fi
	echo "$*: ... $text"
}

eqt --version
try config new mine.yaml --from paper
try config check mine.yaml
try run mine.yaml --set ensemble.runs=4 --out result
try show result
try plot result
try compare result
try report result
try verify mine.yaml --runs 2
try export mine.yaml --controller eqt --out code
ls result/figures result/report.html code >/dev/null

# A package of somebody else: its law, its command and its figure.
"$here/venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps "$(dirname "$wheel")"/example/*.whl
try run "$repository/examples/package/experiment.yaml" --out sizing
try plot sizing --figure actuator
try actuator sizing
grep -q "^bounded_feedback: .* N m suffice for 95% of the runs" out
eqt --help >out
grep -q "actuator" out

printf 'ULog' >flight.ulg
refused "(extra logs)" eqt log check flight.ulg
refused "(extra xarray)" python -c 'import eqt_cli; eqt_cli.open_result("result").to_xarray()'
mkdir nothing
refused "(extra native)" env "PATH=$here/nothing" "$here/venv/bin/eqt" run mine.yaml --out other --engine native
