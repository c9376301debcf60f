"""Simulated vehicles on this machine, with physics behind them and faults on command."""
