"""Runs in virtual and real time, figures, reports, and the ``canroll`` command."""
