from eqt_cli.extensions.underactuated.cascade import Cascade as Cascade
from eqt_cli.extensions.underactuated.flat import FlatReference as FlatReference
