"""Design models: vehicle, observer, controller, and the task of a design."""
