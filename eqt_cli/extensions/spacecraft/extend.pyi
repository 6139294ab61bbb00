from eqt_cli.extensions.spacecraft.momentum_limit import MomentumLimit as MomentumLimit
from eqt_cli.extensions.spacecraft.wheels import Wheels as Wheels
