"""The attitude law of mpc.py by do-mpc, which converges by IPOPT: see docs/experiments/horizon.md.

The rotation vector is that of small errors, twice the vector part of a quaternion.
"""

import sys
from unittest.mock import MagicMock

import numpy as np

# do-mpc imports Matplotlib, which wants to write files, and a law may not.
NAMES = ("matplotlib", "matplotlib.pyplot", "matplotlib.axes", "matplotlib.animation")
sys.modules |= dict.fromkeys(NAMES, MagicMock())
import casadi as ca  # noqa: E402
import do_mpc  # noqa: E402


class Attitude:
    """One object flies one run: do-mpc keeps its last plan, and more."""

    def __init__(self, J, steps, dt, limit, pose, velocity, torque, end):
        J, model = np.array(J), do_mpc.model.Model("continuous")
        q, w = (model.set_variable("_x", name, (n, 1)) for name, n in (("q", 4), ("w", 3)))
        u = model.set_variable("_u", "u", (3, 1))
        for name, n in (("qd", 4), ("wd", 3), ("ud", 3)):
            model.set_variable("_tvp", name, (n, 1))
        model.set_rhs("q", 0.5 * ca.vertcat(-ca.dot(q[1:], w), q[0] * w + ca.cross(q[1:], w)))
        model.set_rhs("w", (ca.cross(J * w, w) + u) / J)
        model.setup()
        q, w, u = model.x["q"], model.x["w"], model.u["u"]
        qd, wd, ud = (model.tvp[name] for name in ("qd", "wd", "ud"))
        error = qd[0] * q[1:] - q[0] * qd[1:] - ca.cross(qd[1:], q[1:])
        cost = 4 * pose * ca.sumsqr(error) + velocity * ca.sumsqr(w - wd)
        self.mpc, self.steps, self.begun = do_mpc.controller.MPC(model), steps, False
        self.mpc.settings.n_horizon, self.mpc.settings.t_step = steps, dt
        self.mpc.settings.n_robust, self.mpc.settings.store_full_solution = 0, False
        self.mpc.settings.supress_ipopt_output()
        self.mpc.set_objective(mterm=end * cost, lterm=cost + torque * ca.sumsqr(u - ud))
        self.mpc.set_rterm(u=0.0)
        self.mpc.bounds["lower", "_u", "u"] = -limit * np.ones(3)
        self.mpc.bounds["upper", "_u", "u"] = limit * np.ones(3)
        self.ahead = self.mpc.get_tvp_template()
        self.mpc.set_tvp_fun(lambda _: self.ahead)
        self.mpc.setup()

    def compute(self, q, w, qs, ws, us):
        """Return the first torque; qs[0] is a period ahead of q."""
        last = q
        for k in range(self.steps + 1):
            j = max(k - 1, 0)
            last = qs[j] if qs[j] @ last >= 0 else -qs[j]
            self.ahead["_tvp", k] = np.concatenate([last, ws[j], us[j]])
        x = np.concatenate([q, w])
        if not self.begun:
            self.mpc.x0, self.begun = x, True
            self.mpc.set_initial_guess()
        return self.mpc.make_step(x[:, None]).ravel()
