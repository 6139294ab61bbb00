"""Parts that eqt works without; nothing outside imports them.

Each is a package with a function `register`, which names what is in it (`eqt_cli.base.extensions`).
Its stub lists what it adds to `eqt_cli`.
"""
