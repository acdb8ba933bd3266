"""Dimensions that are not what was drawn: tolerances, robust design, calibration."""
