"""URDF models of the arms."""
