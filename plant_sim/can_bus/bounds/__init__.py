"""Bounds of response times and delays: analysis, holistic over gateways."""
