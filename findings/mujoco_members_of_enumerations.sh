#!/usr/bin/env bash
# MuJoCo 4.0.0 beside 3.3.7: whether a member of an enumeration equals the NumPy integer that a compiled
# model stores depends on which stands left. model.actuator_dyntype[0] == mjtDyn.mjDYN_FILTER is True in
# both; the other way round it is False in 4.0.0, and so are `in` a tuple of members and a dictionary
# with members as keys, all True in 3.3.7. No warning is given. int(…) of the stored number, or a
# comparison of the whole array, works in both. For eqt this dropped the filter of every actuator of an
# MJCF file, so that a loop that grows was called stable.
#
# Seen: 3.3.7: stored == member True, member == stored True, in a tuple True, in a dictionary True, int True
#       4.0.0: stored == member True, member == stored False, in a tuple False, in a dictionary False, int True
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cat > members.py <<'END'
import mujoco

TEXT = """
<mujoco>
  <worldbody>
    <body><joint name="turn" type="hinge"/><geom size="0.1"/></body>
  </worldbody>
  <actuator><general name="motor" joint="turn" dyntype="filter" dynprm="0.05"/></actuator>
</mujoco>"""
FILTER = mujoco.mjtDyn.mjDYN_FILTER
model = mujoco.MjModel.from_xml_string(TEXT)
stored = model.actuator_dyntype[0]
answers = {
    "stored == member": stored == FILTER,
    "member == stored": FILTER == stored,
    "in a tuple": stored in (FILTER,),
    "in a dictionary": stored in {FILTER: "filter"},
    "int": int(stored) == FILTER,
}
print(f"{mujoco.__version__}:", ", ".join(f"{name} {bool(is_equal)}" for name, is_equal in answers.items()))
assert (model.actuator_dyntype == FILTER).all()
wrong = {name for name, is_equal in answers.items() if not is_equal}
left = {"member == stored", "in a tuple", "in a dictionary"}
assert wrong == (left if mujoco.__version__ == "4.0.0" else set()), wrong
END
for version in 3.3.7 4.0.0; do
	python3 -m venv $version
	$version/bin/pip install --quiet --disable-pip-version-check mujoco==$version
	$version/bin/python members.py
done
