#!/usr/bin/env bash
# MuJoCo 4.0.0 is three distributions (mujoco, mujoco-core, mujoco-studio) that share one folder. Who
# upgrades an environment with 3.3.7 by `pip install mujoco==4.0.0` gets exit code 0 and a package that
# cannot be imported: pip installs mujoco-core first, then uninstalls mujoco 3.3.7, which removes the files
# that both have. `pip check` finds nothing wrong. In a new environment the same command works. The error
# of the import names the cure, `pip install --force-reinstall --no-deps mujoco mujoco-core mujoco-studio`.
#
# Seen: new: 4.0.0
#       upgraded: ModuleNotFoundError: No module named 'mujoco._specs'; pip check: No broken requirements found.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for name in new upgraded; do
	python3 -m venv $name
	$name/bin/pip install --quiet --disable-pip-version-check pip==25.3
done
new/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
upgraded/bin/pip install --quiet --disable-pip-version-check mujoco==3.3.7
upgraded/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
echo "new: $(new/bin/python -c 'import mujoco; print(mujoco.__version__)')"
if upgraded/bin/python -c 'import mujoco' 2> error; then
	echo "upgraded: can be imported"
	exit 1
fi
echo "upgraded: $(grep -m 1 ModuleNotFoundError error); pip check: $(upgraded/bin/pip check)"
grep -q "mujoco-core" error
