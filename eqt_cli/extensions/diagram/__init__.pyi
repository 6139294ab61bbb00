from eqt_cli.extensions.diagram.api import LoopDiagram as LoopDiagram
from eqt_cli.extensions.diagram.api import diagram as diagram
