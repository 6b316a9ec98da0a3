"""Numbered cases driven by processes or a cluster, their rows kept and continued."""
