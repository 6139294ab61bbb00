from eqt_cli.extensions.firmware.call_times import call_times as call_times
from eqt_cli.extensions.firmware.export import ExportedFiles as ExportedFiles
from eqt_cli.extensions.firmware.export import export as export
