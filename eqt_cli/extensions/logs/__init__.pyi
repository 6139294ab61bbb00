from eqt_cli.extensions.logs.api import check_log as check_log
from eqt_cli.extensions.logs.api import log_errors as log_errors
from eqt_cli.extensions.logs.many import check_flights as check_flights

FORMATS_BY_SUFFIX: dict[str, str]
