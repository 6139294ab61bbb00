"""Functions of numbers: derivatives, leaves, traced programs and their C."""
