"""Who starts where: seeds and distributions of initial states."""
