"""Solutions of polynomial equations: followed from problem to problem, found by monodromy, and certified."""
