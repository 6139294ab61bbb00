from eqt_cli.extensions.suite.api import SuiteTable as SuiteTable
from eqt_cli.extensions.suite.api import suite as suite
