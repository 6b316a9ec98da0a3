"""Dynamic output feedback: laws with an estimator of the whole car and its driver."""
