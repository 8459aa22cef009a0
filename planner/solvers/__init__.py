"""Numerical methods for the boundary value problem (section 4.1 of the paper)."""
