"""Networks described: segments, routes, own frames, traffic; from files and profiles."""
