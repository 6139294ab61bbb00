from eqt_cli.extensions.flights.api import compare_conditions as compare_conditions
from eqt_cli.extensions.flights.api import compare_flights as compare_flights
from eqt_cli.extensions.flights.api import compare_measured as compare_measured
from eqt_cli.extensions.flights.api import fit as fit
from eqt_cli.extensions.flights.api import plan_flights as plan_flights
from eqt_cli.extensions.flights.api import replay as replay
from eqt_cli.extensions.flights.confrontation import validate as validate
from eqt_cli.extensions.flights.identify import identify_law as identify_law
