"""Writes lee.c and pd.c by CasADi 3.8.2; tests read what it wrote, and need no CasADi."""

import casadi as ca
import numpy as np

J = np.diag([1.0, 2.0, 3.0])
KR, KW = 2.0, 0.5

R, Rd = ca.SX.sym("R", 3, 3), ca.SX.sym("Rd", 3, 3)
w, wd, dwd = (ca.SX.sym(name, 3) for name in ("w", "wd", "dwd"))
E = 0.5 * (Rd.T @ R - R.T @ Rd)
C = R.T @ Rd
turned = C @ dwd - ca.skew(w) @ C @ wd
tau = -KR * ca.inv_skew(E) - KW * (w - C @ wd) + ca.cross(w, J @ w) + J @ turned
ca.Function("lee", [R, w, Rd, wd, dwd], [tau], ["R", "w", "Rd", "wd", "dwd"], ["tau"]).generate(
    "lee.c"
)

k, late = ca.SX.sym("k", ca.Sparsity.diag(3)), ca.SX.sym("late", 3, 2)
tau = -k @ w + late @ ca.DM([1, 10])
ca.Function("pd", [w, k, late], [tau], ["w", "k", "late"], ["tau"]).generate("pd.c")
