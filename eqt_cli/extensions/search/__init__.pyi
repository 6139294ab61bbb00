from eqt_cli.extensions.search.api import tune as tune
from eqt_cli.extensions.search.api import worst as worst
