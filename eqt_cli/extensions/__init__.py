"""Parts that eqt works without; nothing outside imports them.

Each is a package that names what is in it: `COMPONENTS`, the module of each component by the plural
of its kind; `COMMANDS`, a function, the command that it follows in the help, and the arguments of
its example; `RECORDINGS`, the module that reads files of recordings. Its stub lists what it
adds to `eqt_cli`. So a command imports the code of an extension only where it uses it.
"""
