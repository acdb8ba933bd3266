"""Exact synthesis: all solutions that theory gives, each moved through its precision points."""
