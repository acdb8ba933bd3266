"""Searches for linkages by a curve as the tests run them: a small atlas, and rounds of few designs.

So many lanes everywhere that programs are compiled once for all of them.
"""

import jaxnc as nc
from jaxnc.synthesis.tracing import atlas as making
from jaxnc.synthesis.tracing import trace as searching

LANES = 16  # designs that are refined together
BRIEF = {"_WIDTH": 16, "_TOGETHER": LANES, "_GROUPS": 1, "_DRAWN_KEPT": 6, "_DRAWN": 128}


def shorten(patch, steps=(4, 10, 20)):
    """Make rounds shorter: fewer candidates, and fewer steps for each."""
    patch.setattr(searching, "_STEPS", steps)
    for name, value in BRIEF.items():
        patch.setattr(searching, name, value)


def small_atlas(patch, folder):
    """An atlas of a few thousand linkages."""
    patch.setattr(making, "_PART", 3000)
    return nc.synthesis.atlas(1, folder=folder)
