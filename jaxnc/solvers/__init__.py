"""Solvers: plans for a set of inputs, linear algebra, Newton, continuation along branches, assembly."""
