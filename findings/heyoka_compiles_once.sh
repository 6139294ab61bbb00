#!/usr/bin/env bash
# heyoka 7.13.2: compiled integrators are kept on disk, in $XDG_CACHE_HOME/heyoka/cache.db (else in
# ~/.cache). A second process that builds the same integrator compiles nothing: it takes some 6 % of
# the CPU time of the first. A benchmark that starts a process for each repetition, and takes the
# minimum, therefore measures a run without its compilation; one that takes the first measures both.
# For eqt this meant that a row said "the others compile each time", which was false for heyoka.
#
# Seen: first 0.119 s, second 0.007 s, with an empty cache again 0.118 s; one file, cache.db
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check heyoka==7.13.2 numpy==2.4.0
cat > pendulum.py <<'END'
import time
import heyoka as hy
x, v = hy.make_vars("x", "v")
before = time.process_time()
hy.taylor_adaptive([(x, v), (v, -9.8 * hy.sin(x) + hy.cos(hy.time) * v**2)], [0.1, 0.2], tol=1e-15)
print(time.process_time() - before)
END
built() { XDG_CACHE_HOME="$folder/$1" venv/bin/python pendulum.py; }
mkdir one other
first=$(built one) second=$(built one) emptied=$(built other)
files=$(cd one && find . -type f | sort | head -n 1)
echo "first $first s, second $second s, with an empty cache again $emptied s; $files"
[ "$files" = ./heyoka/cache.db ]
venv/bin/python -c "import sys; a, b, c = map(float, sys.argv[1:]); sys.exit(not (b < 0.4 * a and b < 0.4 * c))" \
	"$first" "$second" "$emptied"
