from eqt_cli.extensions.spacecraft.wheels import Wheels as Wheels
