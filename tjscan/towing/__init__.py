"""Vehicles that carry a welding cable in an optimised shape, after Suzuki et al. (2022)."""
