"""What `eqt_cli` offers and where that is, for type checkers and for the package itself."""

from eqt_cli.api import StoredResult as StoredResult
from eqt_cli.api import Study as Study
from eqt_cli.api import animate as animate
from eqt_cli.api import call_times as call_times
from eqt_cli.api import check_log as check_log
from eqt_cli.api import choose_executor as choose_executor
from eqt_cli.api import cite as cite
from eqt_cli.api import compare as compare
from eqt_cli.api import compare_flights as compare_flights
from eqt_cli.api import compare_measured as compare_measured
from eqt_cli.api import compare_sweep as compare_sweep
from eqt_cli.api import diff as diff
from eqt_cli.api import export as export
from eqt_cli.api import figure as figure
from eqt_cli.api import fit as fit
from eqt_cli.api import load_experiment as load_experiment
from eqt_cli.api import log_errors as log_errors
from eqt_cli.api import open_result as open_result
from eqt_cli.api import pack as pack
from eqt_cli.api import plot as plot
from eqt_cli.api import replay as replay
from eqt_cli.api import run as run
from eqt_cli.api import write_report as write_report
from eqt_cli.base.reporting import Reporter as Reporter
from eqt_cli.base.reporting import reporting as reporting
from eqt_cli.base.version import __version__ as __version__
from eqt_cli.extensions.proofs import *
from eqt_cli.extensions.search import *

def places(module: str) -> dict[str, str]: ...
def lazily(module: str) -> tuple[list[str], object, object]: ...
