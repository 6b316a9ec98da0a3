"""Monitors of the loop: what judges the law and its inputs apart from them."""
