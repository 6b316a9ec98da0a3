"""Parts of a run: choices, controller, and the frames, key and delay of its bus."""
