"""What stands beside the core: each folder is one extension, and can be given up by deleting it."""
