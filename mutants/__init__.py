"""Plants small faults in the mathematical core and asks its tests to tell: `make mutants`."""
