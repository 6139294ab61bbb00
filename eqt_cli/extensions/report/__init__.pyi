from eqt_cli.extensions.report.api import animate as animate
from eqt_cli.extensions.report.api import report as report
