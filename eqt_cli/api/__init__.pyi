"""What `eqt_cli.api` offers and in which of its modules that is."""

from eqt_cli.api.animating import animate as animate
from eqt_cli.api.checking_logs import check_log as check_log
from eqt_cli.api.comparing import compare as compare
from eqt_cli.api.comparing import compare_measured as compare_measured
from eqt_cli.api.comparing import compare_sweep as compare_sweep
from eqt_cli.api.differing import diff as diff
from eqt_cli.api.drawing import Note as Note
from eqt_cli.api.drawing import Shown as Shown
from eqt_cli.api.drawing import check_figures as check_figures
from eqt_cli.api.drawing import plot as plot
from eqt_cli.api.exporting import ExportedFiles as ExportedFiles
from eqt_cli.api.exporting import export as export
from eqt_cli.api.linearising import margins as margins
from eqt_cli.api.loading import Configuration as Configuration
from eqt_cli.api.loading import LoadedExperiment as LoadedExperiment
from eqt_cli.api.loading import load_experiment as load_experiment
from eqt_cli.api.opening import open_results as open_results
from eqt_cli.api.paths import ResultPath as ResultPath
from eqt_cli.api.reporting import write_report as write_report
from eqt_cli.api.running import StoredResult as StoredResult
from eqt_cli.api.running import choose_executor as choose_executor
from eqt_cli.api.running import pack as pack
from eqt_cli.api.running import run as run
from eqt_cli.api.searching import tune as tune
from eqt_cli.api.searching import worst as worst
from eqt_cli.api.verifying import verify as verify
