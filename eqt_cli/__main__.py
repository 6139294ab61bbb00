"""`python -m eqt_cli`: the command `eqt` where its script is not on the path."""

from eqt_cli.cli import main

if __name__ == "__main__":
    main()
