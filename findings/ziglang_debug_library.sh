#!/usr/bin/env bash
# ziglang 0.17.1: `zig cc -shared` without optimisation links the runtime of its checks of undefined
# behaviour. A function of one line becomes a library of 4 MB that needs some 80 functions of the C
# library, fork, execve, kill and connect among them; with -O2, or without the checks, it is 6 kB and
# needs none. Who judges a library by what it imports, as eqt does with a user's law, sees a program
# that starts others. eqt compiles with -O2; its tests pass -fno-sanitize=undefined.
#
# Seen: -O0: 4191816 bytes, 78 symbols; -O2: 6224 bytes, 0 symbols;
#       -O0 -fno-sanitize=undefined: 5608 bytes, 0 symbols
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check ziglang==0.17.1
cat > sum.c <<'END'
double sum(const double *x, int n) { double s = 0; for (int i = 0; i < n; i++) s += x[i]; return s; }
END
needed() { # those that are not weak
	ZIG_GLOBAL_CACHE_DIR=$folder/cache venv/bin/python -m ziglang cc -std=c99 -shared -fPIC "$@" sum.c -o sum.so
	nm -D --undefined-only sum.so | awk '$1 == "U" { sub(/@.*/, "", $2); print $2 }'
}
report() { echo "$*: $(stat -c %s sum.so) bytes, $(wc -w <<<"$symbols") symbols"; }

symbols=$(needed -O0)
report -O0
for name in fork execve kill connect; do
	grep -qx "$name" <<<"$symbols" || { echo "changed: $name is no longer needed"; exit 1; }
done
for flags in "-O2" "-O0 -fno-sanitize=undefined"; do
	# shellcheck disable=SC2086
	symbols=$(needed $flags)
	report "$flags"
	[ -z "$symbols" ] || { echo "changed: $flags needs $symbols"; exit 1; }
done
