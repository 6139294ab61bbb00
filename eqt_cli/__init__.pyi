"""What `eqt_cli` offers, for type checkers; a test compares it with the table `STABLE`."""

from eqt_cli.api import *  # the provisional names
from eqt_cli.api.comparing import compare as compare
from eqt_cli.api.drawing import plot as plot
from eqt_cli.api.loading import load_experiment as load_experiment
from eqt_cli.api.loading import open_result as open_result
from eqt_cli.api.running import run as run
from eqt_cli.api.running import sweep as sweep
from eqt_cli.base.version import __version__ as __version__
from eqt_cli.extensions.export.export import export as export
from eqt_cli.extensions.proofs.margins import margins as margins
from eqt_cli.extensions.proofs.verification import verify as verify
from eqt_cli.extensions.report.api import report as report
from eqt_cli.extensions.search.api import tune as tune
from eqt_cli.extensions.search.api import worst as worst

STABLE: dict[str, str]
