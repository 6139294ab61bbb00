"""What certificates look at: a loop at random states, its runs, and what its experiment assumes."""
