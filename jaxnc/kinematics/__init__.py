"""Kinematics: positions, sweeps, rates, and what a mechanism can do."""
