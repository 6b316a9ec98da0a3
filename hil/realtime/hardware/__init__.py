"""Real interfaces: what each needs, what its time stamps mean, errors and load of the bus."""
