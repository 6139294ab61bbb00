"""The module `eqt_cli.gym`, whose import registers its environments with Gymnasium."""

import sys
from contextlib import suppress

from eqt_cli.extensions import gym

with suppress(ImportError):  # without Gymnasium, `make` says what to install
    from eqt_cli.extensions.gym.registration import register

    register()

sys.modules[__name__] = gym
