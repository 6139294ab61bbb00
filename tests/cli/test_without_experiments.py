"""Commands on results load neither configurations nor what runs them."""

import subprocess
import sys

from ci_cases import mostly_ci

LOADED = (
    "import sys\n"
    "from eqt_cli.cli import main\n"
    "try:\n    main()\n"
    "except SystemExit as end:\n    assert not end.code, end.code\n"
    "apart = ('eqt_cli.config', 'eqt_cli.runs')\n"
    "print([name for name in sys.modules if name.startswith(apart)], file=sys.stderr)"
)


@mostly_ci(
    "command",
    [
        "compare RESULT",
        "compare RESULT --format latex",
        "show RESULT",
        "show RESULT --json",
        "show RESULT --table metrics",
        "plot RESULT --format json --option log=true --out OUT",
        "report RESULT --quick --figure paper --out OUT/page.html",
    ],
    ["compare RESULT"],
    "one command shows what all do",
)
def test_a_result_is_read_without_its_experiment(command, paper_result, tmp_path):
    given = command.replace("RESULT", str(paper_result)).replace("OUT", str(tmp_path)).split()
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *given], capture_output=True, text=True, check=False
    )
    assert done.stderr.splitlines()[-1] == "[]", done.stderr
