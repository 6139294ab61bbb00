from eqt_cli.extensions.export.export import ExportedFiles as ExportedFiles
from eqt_cli.extensions.export.export import export as export
