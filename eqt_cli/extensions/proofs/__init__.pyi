from eqt_cli.extensions.proofs.margins import certified as certified
from eqt_cli.extensions.proofs.margins import margins as margins
from eqt_cli.extensions.proofs.verification import verify as verify
