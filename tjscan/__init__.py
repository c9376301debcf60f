"""Stepwise scanning of the weld groove of large tubular T-joints."""

__version__ = "0.1.0"
