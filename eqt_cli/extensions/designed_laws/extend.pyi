from eqt_cli.extensions.laws.lqr import Eqr as Eqr
from eqt_cli.extensions.laws.lqr import Lqr as Lqr
