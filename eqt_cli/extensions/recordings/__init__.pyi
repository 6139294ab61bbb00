from eqt_cli.extensions.recordings.api import check_log as check_log
from eqt_cli.extensions.recordings.api import compare_flights as compare_flights
from eqt_cli.extensions.recordings.api import compare_measured as compare_measured
from eqt_cli.extensions.recordings.api import fit as fit
from eqt_cli.extensions.recordings.api import log_errors as log_errors
from eqt_cli.extensions.recordings.api import replay as replay

FORMATS_BY_SUFFIX: dict[str, str]
