"""Tests of services in a bundle: sessions answered by the reference."""
