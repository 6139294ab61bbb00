"""Laws as C for a vehicle: files that do not need eqt, with what is known of their errors."""
