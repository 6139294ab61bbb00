"""What integrates a closed loop: solve_ivp, and native, which compiles it."""
