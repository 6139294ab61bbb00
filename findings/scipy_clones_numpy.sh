#!/usr/bin/env bash
# SciPy 1.17.1 with NumPy 2.4.6: `import scipy.linalg` (and `special`, `integrate`, `optimize`, `stats`)
# loads the Fortran wrapper generator numpy.f2py, numpy.testing and unittest. The copy of
# array-api-compat in SciPy takes every name of `dir(numpy)` by getattr, and so wakes the subpackages
# that NumPy loads on demand; `from numpy import *` there does the same. A program that solves one
# equation pays for them at every start: if `dir(numpy)` and `numpy.__all__` hide these two, importing
# scipy.special takes a quarter to a third less processor time.
#
# Seen: numpy: none
#       scipy: none
#       scipy.linalg: numpy.f2py numpy.testing unittest
#       scipy.linalg, two names hidden: none
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 scipy==1.17.1
loaded() { # MODULE HIDDEN: which of the three its import loads
	venv/bin/python - "$1" "$2" <<-'END'
		import importlib, sys
		import numpy
		hidden = sys.argv[2].split()
		if hidden:
		    names = [name for name in dir(numpy) if name not in hidden]
		    numpy.__dir__ = lambda: names
		    numpy.__all__ = [name for name in numpy.__all__ if name not in hidden]
		importlib.import_module(sys.argv[1])
		print(*[x for x in ("numpy.f2py", "numpy.testing", "unittest") if x in sys.modules] or ["none"])
	END
}
bare=$(loaded numpy "")
package=$(loaded scipy "")
linalg=$(loaded scipy.linalg "")
without=$(loaded scipy.linalg "f2py testing")
echo "numpy: $bare"
echo "scipy: $package"
echo "scipy.linalg: $linalg"
echo "scipy.linalg, two names hidden: $without"
test "$bare" = none
test "$package" = none
test "$linalg" = "numpy.f2py numpy.testing unittest"
test "$without" = none
