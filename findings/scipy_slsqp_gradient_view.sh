#!/usr/bin/env bash
# SciPy 1.16.0 and 1.17.1: minimize(method="SLSQP") reads a gradient that is a view with a stride, such as
# a column of a matrix, as if its numbers stood side by side in memory: the second number is that of the
# other column. SciPy 1.15.3, and other methods of 1.17.1 that take bounds, read the same view rightly.
# Here the gradient of (x0 - 0.4)^2 + (x1 - 0.6)^2 is the first column of a matrix whose second column is
# 0: x1 never leaves its start, and success is True. With a copy of the column, the minimum is reached.
# For eqt this sent the search for gains, which polishes its models by SLSQP, away from their minima, and
# a verdict between two laws was wrong.
#
# Seen: 1.15.3 SLSQP    copy [0.4 0.6] view [0.4 0.6] success True
#       1.15.3 L-BFGS-B copy [0.4 0.6] view [0.4 0.6] success True
#       1.15.3 TNC      copy [0.4 0.6] view [0.4 0.6] success True
#       1.17.1 SLSQP    copy [0.4 0.6] view [0.4 0.1] success True
#       1.17.1 L-BFGS-B copy [0.4 0.6] view [0.4 0.6] success True
#       1.17.1 TNC      copy [0.4 0.6] view [0.4 0.6] success True
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
cat > column.py <<'END'
import numpy as np
import scipy
from scipy.optimize import minimize

LOWEST = np.array([0.4, 0.6])


def ended(method, own):
    def gradient(x):
        columns = np.stack([2.0 * (x - LOWEST), np.zeros(2)], axis=1)
        return columns[:, 0].copy() if own else columns[:, 0]

    return minimize(
        lambda x: float(((x - LOWEST) ** 2).sum()),
        [0.9, 0.1],
        jac=gradient,
        method=method,
        bounds=[(0, 1)] * 2,
    )


for method in ("SLSQP", "L-BFGS-B", "TNC"):
    copy, view = ended(method, True), ended(method, False)
    print(
        f"{scipy.__version__} {method:8} copy {copy.x.round(2)} view {view.x.round(2)} "
        f"success {view.success}"
    )
    assert copy.success and view.success
    assert abs(copy.x - LOWEST).max() < 1e-3
    is_wrong = abs(view.x - LOWEST).max() > 0.3
    assert is_wrong == (method == "SLSQP" and scipy.__version__ == "1.17.1")
END
for version in 1.15.3 1.17.1; do
	venv/bin/pip install --quiet --disable-pip-version-check numpy==2.2.6 scipy==$version
	venv/bin/python column.py
done
