#!/usr/bin/env bash
# Gymnasium 1.4.0: the wrapper NormalizeObservation of vector environments works in one of the three
# autoreset modes. With SAME_STEP it is refused with "Expected autoreset_mode to be NEXT_STEP or
# DISABLED"; with DISABLED, which this message offers, it is refused as well, by another sentence that
# knows NEXT_STEP alone. NormalizeReward takes SAME_STEP. So a learner that needs the observation at
# which an episode ends in the step itself has to normalise by code of its own (Stable-Baselines3's
# VecNormalize does). A page of eqt said that DISABLED would do, after the first message.
#
# Seen: NEXT_STEP works; SAME_STEP ValueError, offers DISABLED; DISABLED ValueError, offers NEXT_STEP
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gymnasium==1.4.0 numpy==2.4.0
cat > modes.py <<'END'
import gymnasium as gym
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import NormalizeObservation

for mode in AutoresetMode:
    environments = SyncVectorEnv([lambda: gym.make("Pendulum-v1")] * 2, autoreset_mode=mode)
    try:
        NormalizeObservation(environments).reset(seed=1)
        print(mode.name, "works")
    except ValueError as error:
        words = str(error).partition(", got ")[0]
        offered = [m.name for m in AutoresetMode if m.name in words]
        print(mode.name, "refused, offers", *offered)
END
venv/bin/python modes.py | tee seen
diff seen - <<'END'
NEXT_STEP works
SAME_STEP refused, offers NEXT_STEP DISABLED
DISABLED refused, offers NEXT_STEP
END
