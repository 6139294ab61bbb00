"""Plants small faults in the mathematical core and asks its tests to tell: `make mutants`.

Not mutmut and not cosmic-ray: both start an interpreter that reads all tests anew for every fault,
which takes longer than the tests that tell it, and neither draws by a seed or knows which tests
reach a function.
"""
