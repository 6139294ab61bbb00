"""The data that certificates check: loops at random states, runs, and assumptions."""
