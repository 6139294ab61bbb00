from eqt_cli.extensions.designed_laws.lqr import Eqr as Eqr
from eqt_cli.extensions.designed_laws.lqr import Lqr as Lqr
