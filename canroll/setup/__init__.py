"""What a run is made of: its choices, its controller, and the frames, key and delay of its bus."""
