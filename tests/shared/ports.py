"""The ports of a vehicle by itself, in a state of it and its body."""

import numpy as np

from eqt_cli.components.blocks import COMMAND, SOLVED, Now, blocks_of, body


def ports(vehicle, G, states, *, command=None, Q=None, V=None, solved=None, **how):
    """The ports at a command of the law, or at a pose and a velocity."""
    command = np.zeros(G.dimension) if command is None else command
    Q, V = G.identity if Q is None else Q, 0.0 * np.nan_to_num(command) if V is None else V
    known = {COMMAND: command} | ({} if solved is None else {SOLVED: solved})
    return Now(blocks_of(vehicle, G), body(G, Q, V, states), known, **how)


def after_measuring(vehicle, G, Q, V, errors, states):
    """The states of sensors and estimator after a tick with the true Q and V."""
    now = ports(vehicle, G, states, Q=Q, V=V, acts=True, errors=errors)
    return {**now.after("arrived"), **now.after("estimator")}
