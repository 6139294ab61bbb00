"""The equations as a user of SciPy or JAX writes them: none of eqt's code, one file per group.

`xp` is numpy or jax.numpy. Each module offers `field(xp, t, y, law, body)`, the closed loop of body
and reference as one vector, `start`, its initial value, and `motion`, pose and velocity in it.
"""
