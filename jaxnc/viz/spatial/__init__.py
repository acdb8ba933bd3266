"""Seeing a spatial mechanism: one scene of small solids, painted far to near by matplotlib or by the page."""
