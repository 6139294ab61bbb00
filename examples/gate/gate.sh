#!/bin/sh
# gate.sh COMMIT: fails if a law of this folder is worse than at COMMIT, or is not shown not to be.
set -eu
both=$(mktemp -d)
trap 'rm -r "$both"' EXIT
mkdir "$both/base"
git archive "$1" | tar -x -C "$both/base"
(cd "$both/base" && eqt run law.yaml --out "$both/old" --quiet)
eqt run law.yaml --out "$both/new" --quiet
eqt compare "$both/old" "$both/new" --same reference,initial \
  --fail-on 'mean_attitude_error worse by 5 %' \
  --fail-on 'effort worse by 10 %' --fail-on 'settled worse by 2 points'
