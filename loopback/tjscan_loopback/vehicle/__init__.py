"""A stand-in for vehicles on this machine, with physics behind them and faults on command."""
