from eqt_cli.extensions.firmware.export import ExportedFiles as ExportedFiles
from eqt_cli.extensions.firmware.export import export as export
