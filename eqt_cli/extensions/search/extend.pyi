from eqt_cli.extensions.search.figures import Fronts as Fronts
from eqt_cli.extensions.search.figures import WorstFigure as WorstFigure
