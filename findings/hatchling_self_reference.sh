#!/usr/bin/env bash
# hatchling 1.33.0: an extra that names another extra of the same project, for one system only, is
# replaced by what that extra requires, without the marker. `all = ["this[big]; sys_platform ==
# 'win32'"]` so installs what `big` requires on every system. setuptools 80.9.0 keeps the line as it
# is, and pip evaluates its marker. For eqt this meant a C compiler of 411 MB for every user of '.[all]'.
#
# Seen: hatchling: six; extra == 'all'
#       setuptools: this[big]; sys_platform == "win32" and extra == "all"
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check build==1.3.0 hatchling==1.33.0 setuptools==80.9.0
metadata() { # BACKEND: the requirement of `all` in the wheel
	mkdir "$1"
	cat > "$1/pyproject.toml" <<-END
		[build-system]
		requires = []
		build-backend = "$2"
		[project]
		name = "this"
		version = "1"
		[project.optional-dependencies]
		big = ["six"]
		all = ["this[big]; sys_platform == 'win32'"]
		[tool.hatch.build.targets.wheel]
		bypass-selection = true
	END
	venv/bin/python -m build --wheel --no-isolation "$1" --outdir "$1/dist" >/dev/null
	venv/bin/python - "$1"/dist/*.whl <<-'END'
		import sys, zipfile
		with zipfile.ZipFile(sys.argv[1]) as wheel:
		    (name,) = (name for name in wheel.namelist() if name.endswith("METADATA"))
		    lines = wheel.read(name).decode().splitlines()
		print(*(line.partition(": ")[2] for line in lines if "Requires-Dist" in line and "all" in line))
	END
}
hatchling=$(metadata hatchling hatchling.build)
setuptools=$(metadata setuptools setuptools.build_meta)
echo "hatchling: $hatchling"
echo "setuptools: $setuptools"
[[ $hatchling != *win32* && $hatchling == six* ]] || { echo "changed: hatchling keeps the marker"; exit 1; }
[[ $setuptools == *win32* ]] || { echo "changed: setuptools drops the marker"; exit 1; }
