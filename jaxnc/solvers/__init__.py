"""Solvers: plans for a set of inputs, linear algebra, Newton, walks along branches, assembly."""
