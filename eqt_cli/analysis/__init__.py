"""What follows from results: certificates of the theory, and comparisons of controllers."""
