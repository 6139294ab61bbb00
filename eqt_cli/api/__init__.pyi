"""The names of `eqt_cli.api` and the modules that define them."""

from eqt_cli.api.comparing import compare as compare
from eqt_cli.api.comparing import compare_sweep as compare_sweep
from eqt_cli.api.drawing import Shown as Shown
from eqt_cli.api.drawing import figure as figure
from eqt_cli.api.drawing import plot as plot
from eqt_cli.api.loading import Configuration as Configuration
from eqt_cli.api.loading import ResultPath as ResultPath
from eqt_cli.api.loading import StoredResult as StoredResult
from eqt_cli.api.loading import load_experiment as load_experiment
from eqt_cli.api.loading import open_result as open_result
from eqt_cli.api.running import choose_executor as choose_executor
from eqt_cli.api.running import pack as pack
from eqt_cli.api.running import run as run
from eqt_cli.api.running import sweep as sweep
from eqt_cli.base.reporting import Reporter as Reporter
from eqt_cli.base.reporting import reporting as reporting
from eqt_cli.config.study import Study as Study
from eqt_cli.extensions.budget import *
from eqt_cli.extensions.citations import *
from eqt_cli.extensions.code import *
from eqt_cli.extensions.diagram import *
from eqt_cli.extensions.diff import *
from eqt_cli.extensions.export import *
from eqt_cli.extensions.flights import *
from eqt_cli.extensions.gym import *
from eqt_cli.extensions.live import *
from eqt_cli.extensions.logs import *
from eqt_cli.extensions.proofs import *
from eqt_cli.extensions.report import *
from eqt_cli.extensions.search import *
from eqt_cli.extensions.suite import *
